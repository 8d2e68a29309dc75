"""Many runs of one scene: sweeps over values, studies of what accuracy costs, one pool for both."""
