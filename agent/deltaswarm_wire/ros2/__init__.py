"""The wire of ROS 2 over Zenoh: message definitions, their CDR encoding and type hashes, keys and attachments."""
