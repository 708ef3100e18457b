"""A co-simulation FMU of a user's as a kind of actuator, stated by a TOML file beside it."""
