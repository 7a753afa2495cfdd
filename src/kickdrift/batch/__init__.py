"""Many small systems side by side, a lane of a register each."""

from kickdrift.batch.batch import Batch as Batch
