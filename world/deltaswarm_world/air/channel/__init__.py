"""The pieces that the air is made of, each one model, pure and seeded; `radio.py` composes them."""
