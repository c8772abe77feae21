"""Emulated radio: `radio.py` composes the models in `channel/`; `trace.py` follows one link."""
