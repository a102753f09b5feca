//! The main of a worker program: units in, results out, on its pipes.

use std::process::ExitCode;

use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use elo_core::policy::{Monitor, PolicyFormat};
use elo_core::units::{Site, Work, WorkError};
use elo_core::worker::{JobError, serve};

use crate::output::print_error;

/// Serves units with these plugins until the other side closes the pipe.
pub fn worker_main_with(plugins: &[&[Plugin]]) -> ExitCode {
    let mut site = Site::new(formats(plugins));
    let mut perform = |job: &[u8], inputs: &[Vec<u8>], monitor: &mut dyn Monitor| {
        let work: Work = serde_json::from_slice(job).map_err(|error| JobError::Failed(error.to_string()))?;
        work.perform(inputs, &mut site, monitor).map_err(|error| match error {
            WorkError::Stopped(stopped) => JobError::Stopped(stopped),
            WorkError::Build(_) | WorkError::Failed(_) => JobError::Failed(error.to_string()),
        })
    };
    match serve(std::io::stdin(), std::io::stdout(), &fingerprint(), &mut perform) {
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
