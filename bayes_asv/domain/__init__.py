"""Domain model: vehicles, recordings, channels, units and errors."""
