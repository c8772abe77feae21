"""Emulated radio: `radio.py` composes the models in `channel/`; `reception.py` holds the outcome of a step."""
