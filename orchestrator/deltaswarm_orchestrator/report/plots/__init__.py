"""Figures: data frames in, matplotlib figures out; only `style.save` writes files."""
