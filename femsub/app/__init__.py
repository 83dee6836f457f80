"""What people run: the command line, scenes, reports and figures."""
