//! The conformance suites, for plugins that are written in Python.

use elo_backends::python::passing;
use elo_core::conformance::check::Report;
use elo_core::conformance::{metric, simulator, teacher};
use elo_core::hosted::Hosted;
use elo_core::metric::Metric;
use elo_core::policy::TeacherConfig;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::simulators::{self, described, plugin};

/// The rules that are broken, and a report on all.
type Found = (Vec<String>, String);

fn found(report: &Report) -> Found {
    (report.failed().into_iter().map(str::to_owned).collect(), report.to_string())
}

/// Tries every rule of a role (`simulator`, `teacher` or `metric`) on a config. Teachers are tried on `simulator`.
#[pyfunction]
pub fn conformance(py: Python<'_>, role: &str, config_json: &str, simulator_json: &str) -> PyResult<Found> {
    passing(|| suite(py, role, config_json, simulator_json))
}

fn suite(py: Python<'_>, role: &str, config_json: &str, simulator_json: &str) -> PyResult<Found> {
    match role {
        "simulator" => {
            let case = simulator::Case::new(simulators::simulator(config_json)?);
            Ok(found(&py.detach(|| simulator::run(&case))))
        }
        "teacher" => {
            let mut subject: Box<dyn TeacherConfig> = plugin(config_json)?;
            subject.hosted_mut().map_or(Ok(()), |hosted: &mut dyn Hosted| described(hosted))?;
            let case = teacher::Case::new(subject, simulators::simulator(simulator_json)?);
            Ok(found(&py.detach(|| teacher::run(&case))))
        }
        "metric" => {
            let mut subject: Box<dyn Metric> = plugin(config_json)?;
            subject.hosted_mut().map_or(Ok(()), |hosted: &mut dyn Hosted| described(hosted))?;
            Ok(found(&py.detach(|| metric::run(subject.as_ref()))))
        }
        other => Err(PyValueError::new_err(format!("no conformance suite for `{other}`"))),
    }
}
