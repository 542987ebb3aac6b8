"""JAX made fast: native loops, linear pairs, gathers. Nothing here knows of rendering."""
