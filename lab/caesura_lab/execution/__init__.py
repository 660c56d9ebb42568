"""Task programs on a robot: what can be run (`check`), and a simulated robot that runs it (`executor`)."""
