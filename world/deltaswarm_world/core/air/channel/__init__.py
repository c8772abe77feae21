"""The models of the emulated radio, pure and seeded; `radio.py` composes them."""
