"""How rays search many shapes: trees of boxes, walked by one ray or by a packet."""
