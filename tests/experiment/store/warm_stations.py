"""What the processes of `killing_stations` have at once: imported by the server that forks them."""

from tests.experiment.session.apparatuses import controller
from tests.experiment.store import killing_stations

killing_stations.preloaded = controller()
