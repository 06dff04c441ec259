"""All candidate events of two plane curves as roots of polynomial systems."""
