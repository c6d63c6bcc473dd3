from tactuator.api.chain import build as build
from tactuator.api.chain import calibrate as calibrate
from tactuator.api.chain import check as check
from tactuator.api.chain import design as design
from tactuator.api.chain import examples as examples
from tactuator.api.chain import identify as identify
from tactuator.api.chain import read_controller as read_controller
from tactuator.api.chain import read_curve as read_curve
from tactuator.api.chain import read_display as read_display
from tactuator.api.chain import read_model as read_model
from tactuator.api.chain import read_record as read_record
from tactuator.api.doing import measure_response as measure_response
from tactuator.api.doing import noise as noise
from tactuator.api.doing import play as play
from tactuator.api.doing import render as render
from tactuator.api.doing import reproduce as reproduce
from tactuator.api.doing import thresholds as thresholds
from tactuator.errors import BadInput as BadInput
from tactuator.rig.open import open_rig as open_rig
from tactuator.rig.simulated import SimulatedRig as SimulatedRig

__version__: str
