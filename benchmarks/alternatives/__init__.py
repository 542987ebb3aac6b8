"""Methods that lost, kept to be measured against."""
