"""Running conditions over seeds on this machine: threads or processes, what was done before, progress."""
