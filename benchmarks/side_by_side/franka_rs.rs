//! Holds an arm with the crate franka-rs: `ADDRESS hold|model|time`. Zero torques; besides them five functions of the
//! arm's model in every cycle; or only these five, timed: prints their median [us].
use franka::{Frame, RealtimeConfig, Robot, RobotState, Torques};
use std::{hint::black_box, time::Instant};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().collect();
    let robot = Robot::new(&words[1], RealtimeConfig::Ignore)?;
    let model = if words[2] == "hold" { None } else { Some(robot.load_model()?) };
    let five = |state: &RobotState| {
        if let Some(model) = &model {
            black_box(model.pose(Frame::EndEffector, state));
            black_box(model.zero_jacobian(Frame::EndEffector, state));
            black_box(model.mass(state));
            black_box(model.coriolis(state));
            black_box(model.gravity(state));
        }
    };
    if words[2] == "time" {
        let mut state = robot.read_once()?;
        let mut times: Vec<f64> = (0..20001)
            .map(|k| {
                state.q[k % 7] += 1e-5;
                state.dq[k % 7] = 1e-5 * k as f64;
                let begin = Instant::now();
                five(black_box(&state));
                1e6 * begin.elapsed().as_secs_f64()
            })
            .collect();
        times.sort_by(f64::total_cmp);
        println!("{}", times[times.len() / 2]);
        return Ok(());
    }
    let mut control = robot.start_torque_control()?;
    loop {
        let (state, _) = control.read_once()?;
        five(&state);
        control.write_once(&Torques::new([0.0; 7]))?;
    }
}
