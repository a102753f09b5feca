"""Takes longer to import than a step may take."""

import time

from toys import Mass

time.sleep(2.5)

__all__ = ["Mass"]
