"""The battery: what the diagnosis says about cars whose faults are sealed away, and how often."""
