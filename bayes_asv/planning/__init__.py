"""Before the drive: which road, speed and rate would answer, in how many passes."""
