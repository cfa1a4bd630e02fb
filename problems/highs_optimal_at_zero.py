"""HiGHS 1.15.1 reports "Optimal" at x = 0 with the value 0; the least value is -13/12.

This file needs only highspy. The .mps file of the same name states one step with friction. The objective is t1 + t2
plus a quadratic function of two displacements d, where -t <= d <= t. These constraints imply t >= 0. If the file also
states t >= 0, HiGHS 1.15.1 finds the minimum. HiGHS 1.16.0 also finds the minimum without this bound.
"""

from pathlib import Path

import highspy

highs = highspy.Highs()
highs.setOptionValue("output_flag", False)
highs.readModel(str(Path(__file__).with_suffix(".mps")))
highs.run()
print(highs.version(), highs.modelStatusToString(highs.getModelStatus()), list(highs.getSolution().col_value))
print(f"value {highs.getInfo().objective_function_value}; the value at d = t = (7/6, 1/3) is {-13 / 12}")
