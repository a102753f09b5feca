//! Trains teachers on the default task of a robot and prints learning curves as CSV: the mean return of whole episodes
//! (1000 control steps, standard reset, mean action, no exploration) of every policy kept during training.
//!
//! ```sh
//! cargo run --release -p measurements --bin learning-curves -- rapier half-cheetah 2000000 3 > curve.csv
//! cargo run --release -p measurements --features mujoco --bin learning-curves -- mujoco ant 2000000 3 gamma=0.99
//! ```
//!
//! Arguments: engine, robot, simulator steps, number of seeds, then fields of the teacher's config that differ from its
//! defaults, with their values in JSON. Seeds are trained in turn on one core each, as many at a
//! time as there are cores.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use elo_core::agent::Taught;
use elo_core::context::{Context, InitialStates, PreparedStart};
use elo_core::policy::{Lesson, Monitor, Stopped, TeacherConfig};
use elo_core::rollout::{Ending, Horizon, price, rollout};
use elo_core::seed::Seed;
use elo_core::simulator::SimulatorConfig;
use elo_core::task::Task;
use measurements::{Failure, plugin, robot};

/// Episodes behind each point of a curve.
const EPISODES: u64 = 20;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [engine, robot_name, steps, seeds, fields @ ..] = arguments.as_slice() else {
        return Err(
            "expected: ENGINE ROBOT STEPS SEEDS [FIELD=VALUE]…, e.g. rapier half-cheetah 2000000 3".into()
        );
    };
    let (steps, seeds): (u64, u64) = (steps.parse()?, seeds.parse()?);
    let simulator = robot(engine, robot_name)?;
    let mut teacher_fields = vec![("steps", steps.into())];
    for assignment in fields {
        let (field, value) = assignment.split_once('=').ok_or("expected FIELD=VALUE, e.g. gamma=0.99")?;
        teacher_fields.push((field, serde_json::from_str(value)?));
    }
    let teacher: Box<dyn TeacherConfig> = plugin("ppo", &teacher_fields)?;

    println!("engine,robot,seed,steps,mean_return,standard_deviation,mean_length,falls");
    let (next, trouble) = (AtomicU64::new(1), Mutex::new(None));
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed > seeds {
                        return;
                    }
                    match curve(simulator.as_ref(), teacher.as_ref(), seed) {
                        Ok(lines) => {
                            print!("{}", lines.replace("PREFIX", &format!("{engine},{robot_name},{seed}")))
                        }
                        Err(error) => *trouble.lock().expect("no thread panics with it") = Some(error),
                    }
                }
            });
        }
    });
    trouble.into_inner()?.map_or(Ok(()), Err)
}

/// Trains one teacher; one CSV line a policy kept.
fn curve(simulator: &dyn SimulatorConfig, teacher: &dyn TeacherConfig, seed: u64) -> Result<String, Failure> {
    let (task, initial_states) = (Task::default(), InitialStates::default());
    let root = Seed::root(seed).child("learning-curves");
    let lesson =
        Lesson { simulator, task: &task, initial_states: &initial_states, seed: root.child("teacher") };
    let trained = teacher.train(&lesson, &mut Told { seed, tenths: 0 })?;

    let mut world = simulator.build()?;
    let spec = world.spec().clone();
    let prices = spec.prices(&task);
    let horizon = Horizon { steps: 1000, discount: 1.0, stop_at_fall: true };
    let mut lines = String::new();
    for snapshot in &trained.snapshots {
        let policy = teacher.load(&snapshot.policy, &spec)?;
        let mut agent = Taught { policy: policy.as_ref(), sampling: false };
        let episodes: Vec<(f64, f64, bool)> = (0..EPISODES)
            .map(|episode| {
                let seed = root.child("episode").index(episode);
                let context = Context { task: task.clone(), start: PreparedStart::standard(seed.number()) };
                let done = rollout(world.as_mut(), &mut agent, &context, &horizon, &mut seed.stream());
                (price(&done.term_sums, &prices), f64::from(done.length), done.ending == Ending::Terminated)
            })
            .collect();
        let count = EPISODES as f64;
        let mean = episodes.iter().map(|e| e.0).sum::<f64>() / count;
        let deviation = (episodes.iter().map(|e| (e.0 - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
        let length = episodes.iter().map(|e| e.1).sum::<f64>() / count;
        let falls = episodes.iter().filter(|e| e.2).count() as f64 / count;
        lines += &format!("PREFIX,{},{mean:.1},{deviation:.1},{length:.1},{falls:.2}\n", snapshot.steps);
    }
    Ok(lines)
}

/// Tells on stderr how far a training is, each tenth.
struct Told {
    seed: u64,
    tenths: u64,
}

impl Monitor for Told {
    fn resume(&mut self) -> Option<Vec<u8>> {
        None
    }

    fn checkpoint(&mut self, _: &[u8]) -> Result<(), Stopped> {
        Ok(())
    }

    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped> {
        let tenths = 10 * done / total.max(1);
        if tenths > self.tenths {
            self.tenths = tenths;
            eprintln!("seed {}: {done} of {total} steps", self.seed);
        }
        Ok(())
    }
}
