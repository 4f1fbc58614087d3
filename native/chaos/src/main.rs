//! Kills publishers, readers and BEAM nodes at random times and checks the messages that the
//! readers accept.
//!
//! The killed native processes run this program ([`peers`]), the BEAM nodes run the command
//! after `--`. Readers record the messages that they accept in logs that outlive them
//! ([`record`]). [`judge`] finds faults in these records.

mod fault;
mod half_written;
mod judge;
mod leaks;
mod message;
mod options;
mod peers;
mod plan;
mod processes;
mod random;
mod record;
mod report;
mod ring;

use std::process::ExitCode;

use options::Request;
use program::stop::Stop;
use program::{Failure, Log};

fn main() -> ExitCode {
    let mut clean = true;
    let ended = program::run("chaos", |log| {
        clean = run_request(log)?;
        Ok(())
    });
    if clean { ended } else { ExitCode::FAILURE }
}

/// Runs the program as its arguments say. Returns whether no fault was found.
fn run_request(log: Log) -> Result<bool, Failure> {
    match options::parse(std::env::args().skip(1))? {
        Request::Help => program::print_help(options::HELP),
        Request::Ring { settings, json } => {
            log.line(format!("{} kills, seed {}", settings.kills, settings.seed));
            let stop =
                Stop::of_process(false).map_err(|error| Failure::Runtime(error.to_string()))?;
            let report = ring::run(&settings, &stop, log)?;
            println!("{}", report.text());
            if json {
                println!("{}", report.json());
            }
            return Ok(report.is_clean());
        }
        Request::Publish {
            number,
            topic,
            corrupt,
        } => peers::publish(number, &topic, seed(), corrupt, &stop()?)?,
        Request::Subscribe {
            number,
            topic,
            behaviour,
            log,
        } => peers::subscribe(number, &topic, seed(), behaviour, &log, &stop()?)?,
    }
    Ok(true)
}

/// Returns the stop of a peer, which the end of its standard input requests too: a peer ends with
/// the run that started it.
fn stop() -> Result<Stop, Failure> {
    Stop::of_process(true).map_err(|error| Failure::Runtime(error.to_string()))
}

fn seed() -> u64 {
    std::env::var("CHAOS_SEED")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or_else(random::Random::seed)
}
