"""Many designs of one topology: sweeps, sensitivities, synthesis."""
