import collections.abc

from . import elements as elements
from . import pages as pages
from . import plots as plots
from . import tables as tables
from . import view as view
from .charts import Chart as Chart
from .charts import Charts as Charts
from .charts import Trace as Trace
from .diagnosis_text import report_diagnosis as report_diagnosis
from .elements import Document as Document
from .elements import Section as Section
from .elements import Table as Table
from .elements import join as join
from .evaluation import Evaluated as Evaluated
from .evaluation import evaluate as evaluate
from .format import figures as figures
from .format import list_shown_joints as list_shown_joints
from .origin import Origin as Origin
from .pages import describe_record as describe_record
from .pipeline import FILES as FILES
from .pipeline import Auto as Auto
from .pipeline import auto as auto
from .pipeline import demo as demo
from .pipeline import describe_outcome as describe_outcome
from .rig_drawing import RigDrawing as RigDrawing
from .sections.camera import show_camera as show_camera
from .sections.control import show_controller as show_controller
from .sections.control import show_judgement as show_judgement
from .sections.control import show_tracking as show_tracking
from .sections.data import picture_log as picture_log
from .sections.data import show_check as show_check
from .sections.data import show_file as show_file
from .sections.data import show_logs as show_logs
from .sections.data import show_rig as show_rig
from .sections.diagnosis import show_diagnosis as show_diagnosis
from .sections.excitation import show_excitation as show_excitation
from .sections.model import show_cameras as show_cameras
from .sections.model import show_parameters as show_parameters
from .sections.model import show_torque as show_torque
from .summary import Summary as Summary
from .summary import summary as summary
from .summary import verdict as verdict
from .view import animate as animate
from .view.gaze import outlook as outlook

VIEWS: collections.abc.Mapping[str, tuple[float, float, float]]
PRESETS: collections.abc.Mapping[str, tuple[tuple[int, int], float | None, bool]]
