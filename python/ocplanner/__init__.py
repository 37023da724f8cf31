"""Object-centric planning: learn the object's trajectory from one robot, follow it with another."""
