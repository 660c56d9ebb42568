"""The pipeline of one session, from samples to segments and program, without a network."""
