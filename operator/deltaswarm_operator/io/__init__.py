"""Processes, the fabric, files and clocks."""
