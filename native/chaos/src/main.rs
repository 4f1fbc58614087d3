//! Kills publishers, readers and BEAM nodes of rings at random instants, and judges what was accepted meanwhile.
//!
//! The native processes that are killed are this program again (`peers`), the BEAM nodes are whatever command follows
//! `--`. Readers note what they accept in logs that outlive them (`record`), `judge` tells from these what may not be.

mod judge;
mod message;
mod options;
mod peers;
mod plan;
mod random;
mod record;
mod report;
mod ring;
mod stage;

use std::process::ExitCode;

use options::Request;
use program::stop::Stop;
use program::{Failure, Log};

fn main() -> ExitCode {
    let mut clean = true;
    let ended = program::run("chaos", |log| {
        clean = act(log)?;
        Ok(())
    });
    if clean { ended } else { ExitCode::FAILURE }
}

/// Whether all was as it should be.
fn act(log: Log) -> Result<bool, Failure> {
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
            manner,
            log,
        } => peers::subscribe(number, &topic, seed(), manner, &log, &stop()?)?,
    }
    Ok(true)
}

/// A peer ends with the run that started it: its standard input ends then.
fn stop() -> Result<Stop, Failure> {
    Stop::of_process(true).map_err(|error| Failure::Runtime(error.to_string()))
}

fn seed() -> u64 {
    std::env::var("CHAOS_SEED")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or_else(random::Random::seed)
}
