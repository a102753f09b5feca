//! One run on its way to the page.

use maud::{Markup, html};

use super::chart::{Chart, Figure};
use super::data::RunData;

/// What does not come with every run, and the command that makes it.
#[derive(Clone, Copy, Debug)]
pub enum Part {
    /// `experiments.json`.
    Experiments,
    /// `crosscheck.json`.
    Crosscheck,
}

/// One section of a run.
pub struct Section {
    /// Its name in links.
    pub id: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// The rest.
    pub body: Markup,
}

/// A run, and the plots that were drawn of it so far.
pub struct Sheet<'a> {
    /// The run.
    pub run: &'a RunData,
    /// The id of its part of the page.
    pub anchor: String,
    /// The plots.
    pub figures: Vec<Figure>,
    /// Before the name of each plot, where a page has several runs.
    prefix: String,
}

impl<'a> Sheet<'a> {
    /// An empty sheet for the run at `index` of the page.
    pub fn new(run: &'a RunData, index: usize, several: bool) -> Self {
        let anchor = format!("run-{}", index + 1);
        let prefix = if several { format!("{anchor}-") } else { String::new() };
        Self { run, anchor, figures: Vec::new(), prefix }
    }

    /// The id of a section.
    pub fn section_id(&self, section: &str) -> String {
        format!("{}-{section}", self.anchor)
    }

    /// The id of a plot.
    pub fn plot_id(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// Draws a plot, which is also kept for its file.
    pub fn draw(&mut self, chart: Chart) -> Markup {
        let figure = chart.draw();
        let markup = figure.markup();
        self.figures.push(figure);
        markup
    }

    /// One sentence for a part that is not there, with the command that makes it.
    pub fn absent(&self, what: &str, part: Part) -> Markup {
        let folder = &self.run.folder;
        let command = match part {
            Part::Experiments => format!("elo experiments {folder}"),
            Part::Crosscheck => format!("elo crosscheck {folder} --simulator KIND"),
        };
        html! {
            p.absent { (what) " not measured for this run: " code { (command) } ", then " code { "elo report" } ", adds it." }
        }
    }
}
