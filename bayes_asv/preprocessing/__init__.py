"""From recordings to the arrays a filter takes: time line, splines, bands, tones, data checks."""
