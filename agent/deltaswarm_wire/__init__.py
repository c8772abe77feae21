"""The vocabulary that all parts of deltaswarm share: messages, keys, codec, settings.

It knows nothing of the parts and imports only the standard library and its codec (msgpack).
"""

__version__ = "0.1.0"
