"""Road drives of a real car whose truth nobody knows: what can be said of it, and what cannot."""
