"""Aircraft."""

from .buffet import Buffet as Buffet
from .buffet import buffet_noise as buffet_noise
from .corrections import corrected_accelerations as corrected_accelerations
from .corrections import corrected_angles as corrected_angles
from .gust_scales import AbstractIntensity as AbstractIntensity
from .gust_scales import FixedIntensity as FixedIntensity
from .gust_scales import GustScales as GustScales
from .gust_scales import MilitaryIntensity as MilitaryIntensity
from .instrument_channels import CHANNELS as CHANNELS
from .instruments import Instruments as Instruments
from .noise_levels import BASE as BASE
from .noise_levels import HIGH as HIGH
from .noise_levels import NoiseLevel as NoiseLevel
from .noise_levels import draw as draw
from .noise_levels import report_instruments as report_instruments
from .turbulence import GUSTS as GUSTS
from .turbulence import REPORT_GUSTS as REPORT_GUSTS
from .turbulence import dryden as dryden
from .turbulence import von_karman as von_karman
from .turbulence import white_gusts as white_gusts
from .wind import AbstractWind as AbstractWind
from .wind import BoundaryLayerWind as BoundaryLayerWind
from .wind import Wind as Wind
from .wind import one_minus_cosine as one_minus_cosine
from .wind import one_minus_cosine_rise as one_minus_cosine_rise
