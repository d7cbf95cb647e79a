from .control.experiment import bench_run as bench_run
from .control.tracking import track as track
from .control.tuning import tune as tune
from .diagnosis import diagnose as diagnose
from .diagnosis import rehearse as rehearse
from .dynamics.checking import check as check
from .dynamics.model import nominal as nominal
from .dynamics.simulation import simulate as simulate
from .errors import GimbalPinError as GimbalPinError
from .excitation import excite as excite
from .export.sources import export_controller as export_controller
from .fleet.fleet import compare_fleet as compare_fleet
from .fleet.montecarlo import monte_carlo as monte_carlo
from .identification import Online as Online
from .identification import identify as identify
from .log.io import read_log as read_log
from .log.io import write_log as write_log
from .log.log import Log as Log
from .log.platform import Platform as Platform
from .log.profile import profile_s as profile_s
from .report.pipeline import auto as auto
from .report.view import animate as animate
from .rig.rig import Rig as Rig

__version__: str
