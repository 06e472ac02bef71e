"""The types of the public names, which `__init__.py` loads when they are used."""

from stiction.api.evaluation import evaluate as evaluate
from stiction.api.excitation import excite as excite
from stiction.api.identification import identify as identify
from stiction.api.identification import load_joints as load_joints
from stiction.api.logs import from_arrays as from_arrays
from stiction.api.logs import load_log as load_log
from stiction.api.policy import list_policies as list_policies
from stiction.api.policy import load_policy as load_policy
from stiction.api.policy import verify as verify
from stiction.api.robot import check_robot as check_robot
from stiction.api.robot import list_robots as list_robots
from stiction.api.robot import load_robot as load_robot
from stiction.api.training import export as export
from stiction.api.training import train as train
from stiction.core.draws import check_draws as check_draws
from stiction.core.draws import check_hold as check_hold
from stiction.core.errors import StictionError as StictionError

__version__: str
