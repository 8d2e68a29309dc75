"""Many runs of one scene: sweeps over values, studies of the methods, one pool for both."""
