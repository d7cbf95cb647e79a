from .follower import Memory as Memory
from .follower import Online as Online
from .follower import Progress as Progress
from .follower import progress as progress
from .follower import steps as steps
from .learning import Event as Event
