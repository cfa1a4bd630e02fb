"""HiGHS 1.15.1 reports "Optimal" at x = 0, where the value is 0 instead of -13/12: a report that needs highspy only.

The program in the .mps file of the same name is a step of friction with two unknowns. If the implied bounds t >= 0 are
in the file, HiGHS 1.15.1 is right; HiGHS 1.16.0 is right without these bounds.
"""

from pathlib import Path

import highspy

highs = highspy.Highs()
highs.setOptionValue("output_flag", False)
highs.readModel(str(Path(__file__).with_suffix(".mps")))
highs.run()
print(highs.version(), highs.modelStatusToString(highs.getModelStatus()), list(highs.getSolution().col_value))
print(f"value {highs.getInfo().objective_function_value}; the value at d = t = (7/6, 1/3) is {-13 / 12}")
