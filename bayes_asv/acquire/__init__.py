"""Client of the data logger: frames, blocks, the transfer, and the recording that results."""
