"""What every room stands on: numbers, records, messages, files written whole."""
