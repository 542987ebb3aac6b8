"""Light along one ray, its derivative, and the packets that a picture is made of."""
