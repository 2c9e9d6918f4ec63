"""The structure of LeRobot's base classes, as far as multipanda's packages use it, for tests where LeRobot is not
installed: it brings 2.7 GB. It fakes no robot: the arms of these tests are those of the real program."""
