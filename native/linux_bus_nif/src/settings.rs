//! The settings of lines: the atoms of `BB.Bus.Linux.GPIO` and the kernel's flags for them.

use gpiocdev_uapi::v2::{LineConfig, LineFlags, LineValues};
use rustler::NifUnitEnum;

/// The direction of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, NifUnitEnum)]
pub enum Direction {
    Input,
    Output,
}

/// The bias resistor of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, NifUnitEnum)]
pub enum Pull {
    NotSet,
    None,
    Pullup,
    Pulldown,
}

/// The drive mode of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, NifUnitEnum)]
pub enum Drive {
    PushPull,
    OpenDrain,
    OpenSource,
}

/// The edges that are reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, NifUnitEnum)]
pub enum Trigger {
    None,
    Rising,
    Falling,
    Both,
}

/// All settings of a line.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    pub direction: Direction,
    pub pull: Pull,
    pub drive: Drive,
    pub edges: Trigger,
}

impl Settings {
    /// Returns the kernel's flags.
    pub fn flags(&self) -> LineFlags {
        let direction = match self.direction {
            Direction::Input => LineFlags::INPUT,
            Direction::Output => LineFlags::OUTPUT,
        };
        let pull = match self.pull {
            Pull::NotSet => LineFlags::empty(),
            Pull::None => LineFlags::BIAS_DISABLED,
            Pull::Pullup => LineFlags::BIAS_PULL_UP,
            Pull::Pulldown => LineFlags::BIAS_PULL_DOWN,
        };
        let drive = match self.drive {
            Drive::PushPull => LineFlags::empty(),
            Drive::OpenDrain => LineFlags::OPEN_DRAIN,
            Drive::OpenSource => LineFlags::OPEN_SOURCE,
        };
        let edges = match self.edges {
            Trigger::None => LineFlags::empty(),
            Trigger::Rising => LineFlags::EDGE_RISING,
            Trigger::Falling => LineFlags::EDGE_FALLING,
            Trigger::Both => LineFlags::EDGE_RISING | LineFlags::EDGE_FALLING,
        };
        direction | pull | drive | edges
    }

    /// Returns the kernel's configuration. It includes the levels of outputs, because the kernel
    /// sets outputs without given levels to 0, even those that are already open.
    pub fn config(&self, levels: u64, lines: usize) -> LineConfig {
        let mut config = LineConfig {
            flags: self.flags(),
            ..LineConfig::default()
        };
        if self.direction == Direction::Output {
            config.add_values(&LineValues {
                bits: levels,
                mask: mask(lines),
            });
        }
        config
    }
}

impl From<LineFlags> for Settings {
    fn from(flags: LineFlags) -> Self {
        let one_of = |choices: [(LineFlags, usize); 2]| {
            let found = choices.iter().find(|(flag, _)| flags.contains(*flag));
            found.map_or(0, |(_, choice)| *choice)
        };
        let pulls = [Pull::None, Pull::Pullup, Pull::Pulldown];
        let drives = [Drive::PushPull, Drive::OpenDrain, Drive::OpenSource];
        Self {
            direction: if flags.contains(LineFlags::OUTPUT) {
                Direction::Output
            } else {
                Direction::Input
            },
            pull: pulls[one_of([(LineFlags::BIAS_PULL_UP, 1), (LineFlags::BIAS_PULL_DOWN, 2)])],
            drive: drives[one_of([(LineFlags::OPEN_DRAIN, 1), (LineFlags::OPEN_SOURCE, 2)])],
            edges: Trigger::None,
        }
    }
}

/// Returns a mask with one bit for each line.
pub fn mask(lines: usize) -> u64 {
    u64::MAX >> (64 - lines.clamp(1, 64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_has_a_bit_for_each_line() {
        assert_eq!([mask(1), mask(2), mask(64)], [1, 3, u64::MAX]);
    }

    #[test]
    fn settings_survive_a_conversion_to_flags_and_back() {
        for pull in [Pull::None, Pull::Pullup, Pull::Pulldown] {
            for drive in [Drive::PushPull, Drive::OpenDrain, Drive::OpenSource] {
                for direction in [Direction::Input, Direction::Output] {
                    let settings = Settings {
                        direction,
                        pull,
                        drive,
                        edges: Trigger::None,
                    };
                    let read = Settings::from(settings.flags());
                    assert_eq!(
                        (read.direction, read.pull, read.drive),
                        (direction, pull, drive)
                    );
                }
            }
        }
    }

    #[test]
    fn only_a_configuration_of_outputs_includes_levels() {
        let mut settings = Settings {
            direction: Direction::Output,
            pull: Pull::NotSet,
            drive: Drive::PushPull,
            edges: Trigger::None,
        };
        assert_eq!(settings.config(2, 2).num_attrs, 1);
        settings.direction = Direction::Input;
        assert_eq!(settings.config(2, 2).num_attrs, 0);
    }
}
