"""Many small systems side by side, one in each lane of a register."""

from kickdrift.batch.batch import Batch as Batch
