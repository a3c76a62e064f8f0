"""From recordings to the arrays a filter takes: steps, splines, bands, tones, data checks."""
