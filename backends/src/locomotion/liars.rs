//! Bodies that are wrong in one way each, to try the [`super::laws`] on.

use elo_core::simulator::SimulatorError;

use super::body::{ArticulatedBody, Dynamics, Reading};
use super::laws::{Build, LAWS};
use super::model::RobotModel;

/// One way of being wrong, and the law that must notice.
const LIES: [(Lie, &str); 9] = [
    (Lie::WeakMotors, "torque_accelerates_by_inertia"),
    (Lie::ReversedMotors, "double_pendulum_errs_in_proportion_to_the_step"),
    (Lie::NoPayload, "payload_slows_the_motion"),
    (Lie::NoFriction, "friction_stops_a_sliding_box"),
    (Lie::StuckContacts, "a_resting_box_stays_and_touches_the_floor"),
    (Lie::VelocityOfTheFrame, "torso_velocity_is_that_of_its_centre_of_mass"),
    (Lie::WorldSpin, "a_free_body_turns_about_its_centre_of_mass"),
    (Lie::Drag, "pendulum_gains_no_energy"),
    (Lie::Memory, "replays_are_equal_bit_for_bit"),
];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Lie {
    /// A tenth of each torque is lost.
    WeakMotors,
    /// Torques act the other way round.
    ReversedMotors,
    /// The payload is ignored.
    NoPayload,
    /// The floor's friction is a tenth.
    NoFriction,
    /// Every body always touches the floor.
    StuckContacts,
    /// The torso's velocity is that of its frame's origin.
    VelocityOfTheFrame,
    /// A free root's angular velocity is given and taken in world axes.
    WorldSpin,
    /// Velocities lose a thousandth a control step.
    Drag,
    /// A restore keeps a trace of what went before.
    Memory,
}

struct Liar {
    body: Box<dyn ArticulatedBody>,
    lie: Lie,
    root_quaternion: Option<usize>,
    torso_is_slid: bool,
    size: (usize, usize),
    trace: f64,
}

/// The lies that the laws let through on this engine.
pub(crate) fn undetected(build: &Build<'_>) -> Vec<String> {
    let caught = |lie: Lie, name: &str| {
        let lying = |model: &RobotModel| -> Box<dyn ArticulatedBody> {
            Box::new(Liar {
                body: build(model),
                lie,
                root_quaternion: model.root_quaternion,
                torso_is_slid: model.description.name == "walker2d",
                size: (model.standard_positions.len(), model.velocity_count),
                trace: 0.0,
            })
        };
        LAWS.iter().find(|(law, _)| *law == name).is_some_and(|(_, law)| law(&lying).is_err())
    };
    let missed = LIES.iter().filter(|(lie, law)| !caught(*lie, law));
    missed.map(|(lie, law)| format!("{lie:?} passes {law}")).collect()
}

impl Liar {
    fn honest(&self) -> (Vec<f64>, Vec<f64>) {
        let (mut positions, mut velocities) = (vec![0.0; self.size.0], vec![0.0; self.size.1]);
        self.body.coordinates(&mut positions, &mut velocities);
        (positions, velocities)
    }

    /// A quarter turn about z between own and world axes, which is where the law starts.
    fn swap_spin(&self, velocities: &mut [f64], sign: f64) {
        if self.lie == Lie::WorldSpin && self.root_quaternion.is_some() {
            let [x, y] = [velocities[3], velocities[4]];
            (velocities[3], velocities[4]) = (sign * y, -sign * x);
        }
    }
}

impl ArticulatedBody for Liar {
    fn set_dynamics(&mut self, dynamics: &Dynamics) -> Result<(), SimulatorError> {
        let mut dynamics = *dynamics;
        match self.lie {
            Lie::NoPayload => dynamics.payload = 0.0,
            Lie::NoFriction => dynamics.floor_friction *= 0.1,
            _ => {}
        }
        self.body.set_dynamics(&dynamics)
    }

    fn restore(&mut self, positions: &[f64], velocities: &[f64]) -> Result<(), SimulatorError> {
        let mut velocities = velocities.to_vec();
        self.swap_spin(&mut velocities, 1.0);
        if self.lie == Lie::Memory {
            velocities[0] += self.trace;
            self.trace += 1e-15;
        }
        self.body.restore(positions, &velocities)
    }

    fn advance(&mut self, torques: &[f64]) -> Result<(), SimulatorError> {
        let factor = match self.lie {
            Lie::WeakMotors => 0.9,
            Lie::ReversedMotors => -1.0,
            _ => 1.0,
        };
        let torques: Vec<f64> = torques.iter().map(|torque| factor * torque).collect();
        self.body.advance(&torques)?;
        if self.lie == Lie::Drag {
            let (positions, mut velocities) = self.honest();
            velocities.iter_mut().for_each(|v| *v *= 0.999);
            self.body.restore(&positions, &velocities)?;
        }
        Ok(())
    }

    fn read(&self, reading: &mut Reading) {
        self.body.read(reading);
        match self.lie {
            Lie::StuckContacts => reading.on_floor.fill(true),
            Lie::VelocityOfTheFrame if self.torso_is_slid => {
                let (_, velocities) = self.honest();
                reading.torso_velocity = [velocities[0], 0.0, velocities[1]];
            }
            _ => {}
        }
    }

    fn coordinates(&self, positions: &mut [f64], velocities: &mut [f64]) {
        self.body.coordinates(positions, velocities);
        self.swap_spin(velocities, -1.0);
    }
}
