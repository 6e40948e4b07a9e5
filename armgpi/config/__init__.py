"""The experiment file: robot, plant, controllers, reference and horizon as YAML, checked, and as objects.

Takes YAML.
Gives an :class:`Experiment`, or an error that names file, line and key.

``schema.py`` says what it may contain, ``reading.py`` reads and checks it, ``building.py`` makes the
objects: each from its section, by ``arms.py``, ``plants.py``, ``controllers.py`` and ``references.py``.
"""

from armgpi.config.building import Experiment, build, robot
from armgpi.config.controllers import controller, told_context
from armgpi.config.reading import Loaded, Origin, check, dump, parse, read, standard_law
from armgpi.config.schema import ExperimentConfig

__all__ = [
    "Experiment",
    "ExperimentConfig",
    "Loaded",
    "Origin",
    "build",
    "check",
    "controller",
    "dump",
    "parse",
    "read",
    "robot",
    "standard_law",
    "told_context",
]
