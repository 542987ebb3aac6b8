"""Files that are wrong in systematic ways, and what jaxrt makes of them: refused in one line, or read rightly."""
