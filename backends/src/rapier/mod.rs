//! Robots in Rapier (`rapier3d-f64` 0.36.1), which is pure Rust: it is linked into the program and runs in its threads.
//!
//! An MJCF file becomes one multibody in reduced coordinates with as few links as possible (`skeleton`, `segment`),
//! whose masses, armatures, damping and springs are the file's. What the engine cannot represent is refused by name
//! (`unsupported`): ball joints, tendons, equalities, contact pairs, other actuators than motors, other geoms than
//! spheres, capsules and boxes that collide. The parser drops `solref` and `solimp`: contacts have Rapier's own softness.
//!
//! # What differs from the paper's physics
//!
//! As in MuJoCo: unit axes, no drag on links, no restitution. Friction acts as a cone of the greater of two coefficients.
//! Joint limits are absorbing stops that bring a joint which starts outside back at half its excess per second.
//! A body touches the floor when one of its geoms is within 1 mm of it.
//!
//! # A state is its coordinates
//!
//! The engine would carry contact impulses from one step to the next. They are dropped: with them a restored state goes
//! on otherwise than the run did (joint speeds differ by up to 20 rad/s after one control step), and robots at rest tremble
//! (the floor's force varies from 0.80 to 1.14 of the weight). Without them, and with four iterations instead of one,
//! planar robots go on bit for bit, the ant to 1e-11, and the force at rest is the weight to 1e-5. Each episode begins in
//! a copy of a pristine world, about 40 µs, so neither other episodes nor threads change a bit.
//!
//! # How a control step is divided
//!
//! A control step is `steps_per_control` engine steps of `substeps` parts. In each part the equations of motion are
//! solved anew; contacts are found, and torques turned to their joints' axes, once an engine step. Measured by
//! `cargo bench -p elo-backends --bench rapier_step` on a busy two-core x86-64 machine (costs: best of 200 episodes;
//! errors: against 64 engine steps, root mean square over the coordinates, 40 episodes of gentle random torques;
//! laws: which of the locomotion layer's laws of mechanics fail):
//!
//! | steps × parts | µs: ant, half-cheetah, walker2d | error in the air | error on the floor | laws that fail |
//! | --- | --- | --- | --- | --- |
//! | 1 × 1 | 38, 21, 21 | 0.012, 0.026, 0.024 | 0.053, 0.172, 0.064 | six |
//! | 1 × 2 | 63, 33, 33 | 0.006, 0.013, 0.011 | 0.038, 0.127, 0.040 | sliding box |
//! | 2 × 1 | 72, 40, 40 | 0.006, 0.013, 0.011 | 0.042, 0.084, 0.036 | sliding box |
//! | 1 × 4 | 117, 57, 55 | 0.003, 0.006, 0.005 | 0.025, 0.119, 0.033 | sliding box |
//! | 2 × 2 | 124, 64, 63 | 0.003, 0.006, 0.005 | 0.025, 0.064, 0.027 | none |
//! | **4 × 1** | **142, 78, 76** | **0.003, 0.006, 0.005** | **0.024, 0.048, 0.023** | **none** |
//! | 8 × 1 | 277, 163, 160 | 0.001, 0.003, 0.003 | 0.013, 0.019, 0.012 | none |
//!
//! In the air only the number of parts counts. On the floor only engine steps reduce the error in proportion: one step
//! of many parts keeps the contacts of its beginning (half-cheetah at 1 × 8: 0.13 still). So the default takes engine
//! steps of the file's own `timestep`, 4 × 1 for the built-in robots, which is also how MuJoCo steps them; 2 × 2 obeys
//! the laws too, at an eighth less.
//!
//! Over half of the time goes into the engine's dense mass matrices, a tenth into contacts, 1.5 % into this module.

mod builder;
mod config;
mod coordinates;
mod engine;
mod inertia;
mod motors;
mod segment;
mod settings;
mod shape;
mod skeleton;
mod unsupported;

pub use config::RapierConfig;
pub use engine::RapierBody;
pub use settings::Division;
