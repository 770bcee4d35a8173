"""The compiled engine: kinematics and dynamics as expressions that heyoka compiles."""
