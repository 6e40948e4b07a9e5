"""Plants: what the controller acts on, with its loads, sensors and actuators."""
