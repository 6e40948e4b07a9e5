"""The supervisor around a controller: it checks every sample, stops the arm under control, and holds it.

Takes a controller and limits.
Gives a controller (:class:`~armgpi.Supervised`) and the reason of a stop.

States: INIT (the torque ramps to the law's first one), RUN, STOPPING (the law follows a reference that
decelerates), HOLD (the arm has stopped, and is held by the law), FAULT (open loop: nothing is measured that
can be trusted, or the law does not get the arm to follow). Only a reset leads back.

It is elementwise, like a law: what NumPy runs here is what exported C does.

- `bounds`: what is declared of it, and the same as numbers for an arm and a sample time.
- `state`: states, reasons, and what is kept from sample to sample.
- `checks`: one class for each reason, with what it keeps. `stop`: how the arm is stopped.
- `supervised`: the controller under it.
"""

from armgpi.supervisor.bounds import FARTHEST as FARTHEST
from armgpi.supervisor.bounds import Bounds as Bounds
from armgpi.supervisor.bounds import Supervisor as Supervisor
from armgpi.supervisor.bounds import complete_settings as complete_settings
from armgpi.supervisor.bounds import frozen_samples as frozen_samples
from armgpi.supervisor.bounds import least_acceleration as least_acceleration
from armgpi.supervisor.state import COUNTED as COUNTED
from armgpi.supervisor.state import OF_TOOL as OF_TOOL
from armgpi.supervisor.state import SIGNALS as SIGNALS
from armgpi.supervisor.state import FaultReport as FaultReport
from armgpi.supervisor.state import FrozenState as FrozenState
from armgpi.supervisor.state import Reason as Reason
from armgpi.supervisor.state import ResponseState as ResponseState
from armgpi.supervisor.state import State as State
from armgpi.supervisor.state import SupervisedState as SupervisedState
from armgpi.supervisor.state import Watch as Watch
from armgpi.supervisor.supervised import Supervised as Supervised
