"""Measurements of jaxrt's speed and accuracy, each a command that prints a table: see README.md."""
