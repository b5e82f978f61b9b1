"""Text to tree and back; what is said about text that cannot be read."""
