"""The vocabulary shared by all parts of deltaswarm: messages, keys, codec, settings.

It does not depend on any part and imports only the standard library and its codec (msgpack).
"""

__version__ = "0.1.0"
