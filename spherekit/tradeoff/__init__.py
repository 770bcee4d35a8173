"""Speed against accuracy, measured: settings of a run, their times and true errors."""
