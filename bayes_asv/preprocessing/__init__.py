"""From recordings to the arguments of a filter: steps, splines, bands, tones, data checks."""
