"""What is attained where: events, the systems that hold there, critical pairs, derivatives."""
