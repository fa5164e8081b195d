#!/bin/sh
# five iterations by the command line alone: PYTHON is the interpreter, robot.py stands for the robot
set -eu
for k in 1 2 3; do "$PYTHON" robot.py repeat_$k.csv 10$k; done
"$PYTHON" robot.py run_0.csv 0
for k in 0 1 2 3 4; do
    "$PYTHON" -m gtmodel.cli solve technician.toml --set "log.files=[\"run_$k.csv\"]" --out next_$k --json > answer_$k.json
    "$PYTHON" robot.py run_$((k + 1)).csv $((k + 1)) next_$k/next_input.csv
done
"$PYTHON" -m gtmodel.cli solve technician.toml --set 'log.files=["run_5.csv"]' --out next_5 --json > answer_5.json
