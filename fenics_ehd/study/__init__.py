"""Many runs of one scene: sweeps over values, studies of reduction methods, and their workers."""
