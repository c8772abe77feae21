"""Figures: each module turns data into matplotlib figures; only `style` writes files."""
