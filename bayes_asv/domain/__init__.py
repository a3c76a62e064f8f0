"""What the package is about: vehicles, recordings, channels, units and errors."""
