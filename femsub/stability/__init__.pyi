from .tracking import Tracked as Tracked
