//! How the engine is set up.

use rapier3d_f64::dynamics::{IntegrationParameters, SpringCoefficients};

/// How the engine divides a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Division {
    /// Engine steps in it: contacts are found and torques turned to their axes once in each.
    pub steps: usize,
    /// Parts of an engine step, in each of which the equations of motion are set up and solved anew.
    pub substeps: usize,
}

pub(super) fn parameters(control_step: f64, division: Division) -> IntegrationParameters {
    IntegrationParameters {
        dt: control_step / division.steps as f64,
        num_solver_iterations: division.substeps,
        // Nothing is carried from step to step but coordinates: without this a restored state does not continue as
        // the run did, and robots at rest tremble (figures in the module). More iterations make up for it.
        warmstart_coefficient: 0.0,
        contact_recycling: false,
        num_internal_pgs_iterations: 4,
        num_internal_stabilization_iterations: 4,
        // The floor is a half-space, which nothing can pass.
        max_ccd_substeps: 0,
        ..IntegrationParameters::default()
    }
}

/// Joint limits are absorbing stops, as in the robots' files for MuJoCo and in Roboschool: a joint that moves outwards
/// stops, and one that starts outside stays there until something pushes it in, but for a return at half its excess per
/// second. (The engine's own default returns within one part of a step, with hundreds of rad/s; and a soft spring would
/// depend on the length of the step, because the engine forgets the velocity with which it corrects positions.)
pub(super) fn limit_softness() -> SpringCoefficients<f64> {
    // Rate of return ω / (2 ζ) = 0.5/s; the compliance, 1/(4 ζ² · rate · step) or about 1e-4, is as good as none.
    let (angular_frequency, damping_ratio) = (1000.0, 1000.0);
    SpringCoefficients::new(angular_frequency / std::f64::consts::TAU, damping_ratio)
}
