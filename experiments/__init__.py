"""Studies made with hapscene: stability beyond the critical limits, and teleoperation after the haptography paper."""
