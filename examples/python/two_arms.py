#!/usr/bin/env python3
"""Two arms: each with a law of its own, then both hands by one law, then a stop of one while the other goes on.

PYTHONPATH=python .venv/bin/python examples/python/two_arms.py
"""

import multipanda as mp


def main():
    with mp.run("two_arms") as run:
        hands = {name: run[f"{name}_cartesian"] for name in run.arms}
        goals = [law.goal("pose", run.arms[name].state.pose.moved(z=0.05), duration_s=1) for name, law in hands.items()]
        for goal in goals:  # both move at once
            goal.wait()
        print("both hands 5 cm higher")

        try:
            run.switch(["dual", "left_joint"])
        except mp.Refused as refused:  # nothing has changed
            print("refused:", refused)
        answer = run.switch("dual")  # one law for both hands, between two cycles
        print("switched:", answer["stopped"], "to", answer["started"])

        run.switch("right_cartesian", deactivate="dual")
        run.arms["left"].stop()  # held until resume()
        run["right_cartesian"].goal("pose", run.arms["right"].state.pose.moved(z=-0.05), duration_s=1).wait()
        print({name: state.controllet for name, state in run.state().arms.items()})
    print(run.summary)


if __name__ == "__main__":
    main()
