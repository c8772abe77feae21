"""Figures: data frames in, matplotlib figures out; only `style` writes files."""
