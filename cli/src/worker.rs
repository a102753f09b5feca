//! The main of a worker program: units in, results out, on its pipes.

use std::process::ExitCode;

use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use elo_core::policy::{Monitor, PolicyFormat};
use elo_core::units::{Site, Work};
use elo_core::worker::{Identity, JobError, own_pipes, serve};

use crate::output::print_error;

/// Serves units in `engine` (its name and version) with these plugins until the other side closes the pipe.
pub fn worker_main_with(engine: &str, plugins: &[&[Plugin]]) -> ExitCode {
    let mut site = Site::new(formats(plugins));
    let mut perform = |job: &[u8], inputs: &[Vec<u8>], monitor: &mut dyn Monitor| {
        let work: Work = serde_json::from_slice(job).map_err(|error| JobError::invalid(error.to_string()))?;
        work.perform(inputs, &mut site, monitor).map_err(|error| JobError::failed(error.to_string()))
    };
    let build = build();
    let identity = Identity { fingerprint: &build, engine };
    let served = own_pipes().and_then(|(input, output)| serve(input, output, &identity, &mut perform));
    match served {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            print_error(&format!("worker: {error}"));
            ExitCode::FAILURE
        }
    }
}

/// The formats of option policies that these plugins read.
pub fn formats(plugins: &[&[Plugin]]) -> Vec<PolicyFormat> {
    plugins.iter().flat_map(|slice| slice.iter()).filter_map(|plugin| plugin.format).collect()
}

/// What program and worker must share: version, processor class and the sources that both were built from. A worker that was
/// left over from before a change of the code would compute other results under the same keys.
pub fn build() -> String {
    format!("{}, sources {}", fingerprint(), env!("ELO_SOURCES"))
}
