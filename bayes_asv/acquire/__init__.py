"""The laptop's side of the data logger: frames, blocks, the talk, and the recording they make."""
