"""Many designs of one topology: sizes varied, figures of merit, sensitivity, synthesis."""
