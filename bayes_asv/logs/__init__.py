"""What a foreign log holds: facts, the channels that are probably meant, and static calibration."""
