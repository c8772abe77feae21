"""The air between the radios: `radio.py` is the whole, `channel/` its models, `trace.py` follows one link."""
