//! Loading models: the only place that hands text to libmujoco.

use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError, Weak};

use mujoco_rs::logging::set_log_handler;
use mujoco_rs::mujoco_c::mjtDisableBit;
use mujoco_rs::prelude::{MjLogMessage, MjModel};
use mujoco_rs::wrappers::mj_logging::MjtLogLevel;

/// Compiled models by their text, while any simulator uses them.
static MODELS: Mutex<Vec<(String, Weak<MjModel>)>> = Mutex::new(Vec::new());
static QUIET: Once = Once::new();

/// The compiled model of an MJCF text, shared by everyone who asks for the same text. Compiling takes about a millisecond
/// and happens in one thread at a time.
///
/// The model never resets itself when a number goes bad (MuJoCo's default hides such states). Its actuators are off:
/// torques are applied to the joints. Constraint islands are off too: a robot is one island, and looking for it takes
/// nearly half of the ant's step.
///
/// # Errors
/// MuJoCo's message.
pub fn model(text: &str) -> Result<Arc<MjModel>, String> {
    let mut models = lock();
    QUIET.call_once(|| {
        // SAFETY: nobody in this crate has used MuJoCo before the first model is loaded, and that happens under this lock.
        unsafe { set_log_handler(log) };
    });
    models.retain(|(_, model)| model.strong_count() > 0);
    let known = models.iter().find(|(key, _)| key == text).and_then(|(_, model)| model.upgrade());
    if let Some(model) = known {
        return Ok(model);
    }
    let mut model = MjModel::from_xml_string(text).map_err(|error| error.to_string())?;
    let off =
        [mjtDisableBit::mjDSBL_AUTORESET, mjtDisableBit::mjDSBL_ACTUATION, mjtDisableBit::mjDSBL_ISLAND];
    off.into_iter().for_each(|flag| model.opt_mut().disableflags |= flag as i32);
    let model = Arc::new(model);
    models.push((text.to_owned(), Arc::downgrade(&model)));
    Ok(model)
}

fn lock() -> MutexGuard<'static, Vec<(String, Weak<MjModel>)>> {
    MODELS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// MuJoCo's default writes warnings to the terminal and to a file in the working folder. Warnings are counted in the data
/// and looked at after every step, so only what ends the process is worth a line.
fn log(message: &MjLogMessage) {
    if message.level() == MjtLogLevel::mjLOG_ERROR {
        eprintln!("MuJoCo ends this process: {}", message.subject());
    }
}
