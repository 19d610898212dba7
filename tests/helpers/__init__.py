"""What several tests share: judges, generators, loops, programs to be started."""
