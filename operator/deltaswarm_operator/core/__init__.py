"""What decides: no clock, thread, socket, file or randomness of its own."""
