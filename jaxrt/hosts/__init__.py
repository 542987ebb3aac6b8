"""Several hosts that work on one thing: who they are, how they are started, what they exchange."""
