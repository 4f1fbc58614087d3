//! Files of other users under a topic's name: they are never mapped nor published into, and their
//! owners can kill no process by them.
//!
//! Only root can act as another user. Without root's rights these tests print that and test
//! nothing.
#![cfg(not(loom))]

mod support;

use std::fs;
use std::os::unix::fs::chown;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use conduit_ring::repair::{self, Repair};
use conduit_ring::{
    Error, Fault, Guard, Info, Observer, ObserverOptions, Publisher, PublisherOptions, Read,
    Received, Start, State, Subscriber, SubscriberOptions, Topic, Wait, trust,
};
use support::{Helper, LONG, Scratch, next, next_message, report_ready, role};

/// The user `nobody`.
const STRANGER: u32 = 65_534;

/// The program of a helper process; not a test.
#[test]
fn child() {
    let Some((role, topic)) = role() else { return };
    match role.as_str() {
        "trusting" => {
            let mut publisher = publisher(&topic).unwrap();
            publisher.publish(b"taken over").unwrap();
            publisher.abandon();
            let mut reader = subscriber(&topic, Guard::Auto);
            let mut publisher = self::publisher(&topic).unwrap();
            publisher.publish(b"read").unwrap();
            next_message(&mut reader, &mut Vec::new());
            assert_eq!(publisher.info().readers.len(), 1);
            publisher.abandon();
        }
        "misled" => {
            let error = publisher(&topic).unwrap_err();
            assert!(matches!(error, Error::InvalidTrust { .. }), "{error}");
        }
        role => panic!("{role}"),
    }
    report_ready();
}

fn publisher(topic: &Topic) -> Result<Publisher, Error> {
    Publisher::open(topic, &PublisherOptions::default())
}

fn subscriber(topic: &Topic, guard: Guard) -> Subscriber {
    let options = SubscriberOptions {
        guard,
        ..Default::default()
    };
    Subscriber::open(topic, &options).unwrap()
}

/// Gives a topic's file to another user; `false` where that is not allowed.
fn give_away(topic: &Topic) -> bool {
    let given = chown(topic.path(), Some(STRANGER), None).is_ok();
    if !given {
        eprintln!("only root can give a file away: not tested");
    }
    given
}

fn leave_dead(topic: &Topic) {
    let mut publisher = publisher(topic).unwrap();
    publisher.publish(b"bait").unwrap();
    publisher.abandon();
}

fn is_mapped(topic: &Topic) -> bool {
    let maps = fs::read_to_string("/proc/self/maps").unwrap();
    maps.contains(&topic.path().display().to_string())
}

/// A process of the stranger's that shortens a file and restores it, again and again.
struct Truncater {
    /// It leads a process group of its own, with the programs that it calls.
    shell: Child,
    /// What it restores. It is removed when the process has ended.
    _bait: Scratch,
}

impl Truncater {
    fn start(topic: &Topic) -> Truncater {
        let bait = Scratch::new();
        fs::copy(topic.path(), bait.path()).unwrap();
        chown(bait.path(), Some(STRANGER), None).unwrap();
        let script = "while :; do truncate -s 0 $0; truncate -s 2000 $0; \
                      truncate -s 1300 $0; cat $1 > $0; done";
        let shell = Command::new("sh")
            .args(["-c", script])
            .args([topic.path(), bait.path()])
            .uid(STRANGER)
            .process_group(0)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Truncater { shell, _bait: bait }
    }
}

impl Drop for Truncater {
    fn drop(&mut self) {
        let group = format!("-{}", self.shell.id());
        let kill = Command::new("kill").args(["-KILL", "--", &group]).status();
        self.shell.wait().unwrap();
        assert!(kill.unwrap().success());
    }
}

#[test]
fn a_publisher_refuses_a_strangers_file_whatever_is_in_it_and_names_the_owner() {
    let make: [fn(&Topic); 5] = [
        leave_dead,
        // A legacy publisher's.
        |topic| {
            let mut bytes = vec![0; 1216 + 4 * 64];
            for (at, value) in [(0, 4_u32), (4, 64), (8, 16)] {
                bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            }
            fs::write(topic.path(), bytes).unwrap();
        },
        |topic| fs::write(topic.path(), b"").unwrap(),
        |topic| fs::write(topic.path(), b"no ring").unwrap(),
        |topic| fs::write(topic.path(), vec![0; 100_000]).unwrap(),
    ];
    for make in make {
        let topic = Scratch::new();
        make(&topic);
        if !give_away(&topic) {
            return;
        }
        let before = fs::read(topic.path()).unwrap();
        let refusal = publisher(&topic).unwrap_err();
        assert!(
            matches!(refusal, Error::ForeignOwner { user: STRANGER, .. }),
            "{refusal}"
        );
        let words = refusal.to_string();
        let owner = match trust::user_name(STRANGER) {
            Some(name) => format!("belongs to user 65534 ({name})"),
            None => "belongs to user 65534".into(),
        };
        assert!(words.contains(&owner), "{words}");
        assert!(words.contains(&topic.path().display().to_string()));
        assert!(words.contains("CONDUIT_RING_TRUSTED_UIDS"));
        assert_eq!(fs::read(topic.path()).unwrap(), before);
        assert!(!is_mapped(&topic));
    }
}

#[test]
fn force_replaces_a_strangers_file_and_does_not_use_it() {
    let topic = Scratch::new();
    leave_dead(&topic);
    if !give_away(&topic) {
        return;
    }
    let options = PublisherOptions {
        force: true,
        ..Default::default()
    };
    let mut publisher = Publisher::open(&topic, &options).unwrap();
    assert_eq!(publisher.publish(b"new"), Ok(0));
    assert_eq!(Info::read(&topic).unwrap().epoch, 0);
}

#[test]
fn a_user_or_group_that_the_environment_lists_is_trusted() {
    for variables in [
        ("CONDUIT_RING_TRUSTED_UIDS", "7, 65534"),
        ("CONDUIT_RING_TRUSTED_UIDS", "nobody"),
        ("CONDUIT_RING_TRUSTED_GIDS", "65533"),
    ] {
        let topic = Scratch::new();
        leave_dead(&topic);
        if chown(topic.path(), Some(STRANGER), Some(65_533)).is_err() {
            return;
        }
        assert!(publisher(&topic).is_err());
        drop(Helper::start_in("trusting", &topic, &[variables]));
        let info = Info::read(&topic).unwrap();
        assert_eq!((info.published, info.epoch), (3, 2), "{variables:?}");
    }
}

#[test]
fn an_invalid_list_is_an_error_where_it_counts() {
    let topic = Scratch::new();
    leave_dead(&topic);
    if give_away(&topic) {
        let variables = [("CONDUIT_RING_TRUSTED_UIDS", "vision;camera")];
        drop(Helper::start_in("misled", &topic, &variables));
    }
}

#[test]
fn a_strangers_topic_is_read_without_a_mapping_and_without_a_reader_slot() {
    let topic = Scratch::new();
    let owner = publisher(&topic).unwrap();
    let mut owner = Some(owner);
    if !give_away(&topic) {
        return;
    }
    let publisher = owner.as_mut().unwrap();
    let mappings = || {
        let maps = fs::read_to_string("/proc/self/maps").unwrap();
        let path = topic.path().display().to_string();
        maps.lines().filter(|line| line.contains(&path)).count()
    };
    let publishers_own = mappings();
    let mut readers: Vec<_> = (0..20)
        .map(|n| [Guard::Auto, Guard::Always][n % 2])
        .map(|guard| subscriber(&topic, guard))
        .collect();
    let mut observer = Observer::open(&topic, &ObserverOptions::default()).unwrap();
    let mut buffer = Vec::new();
    for n in 0..3 {
        publisher.publish(b"for all").unwrap();
        for reader in &mut readers {
            assert_eq!(next_message(reader, &mut buffer), (n, 0));
        }
        assert!(matches!(
            observer.read_timeout(&mut buffer, LONG),
            Ok(Read::Message(_))
        ));
    }
    publisher.publish(b"lent").unwrap();
    let Received::Message(_, lease) = readers[0].try_lease().unwrap() else {
        panic!("no message");
    };
    assert!(!lease.holds_slot());
    assert_eq!(lease.to_vec(), b"lent");
    assert_eq!(mappings(), publishers_own);
    let raw = fs::read(topic.path()).unwrap();
    assert_eq!(raw[128..132], [0; 4], "subscriber_mask");
    assert_eq!(raw[136..148], [0; 12], "the other masks");
    assert_eq!(publisher.info().readers, []);

    let mut sleeper = readers.pop().unwrap();
    next_message(&mut sleeper, &mut buffer);
    let waker = sleeper.waker();
    thread::scope(|scope| {
        let asleep = scope.spawn(|| sleeper.wait(LONG).unwrap());
        waker.wake();
        assert_eq!(asleep.join().unwrap(), Wait::Woken);
    });
    owner.take().unwrap().close();
    assert_eq!(next(&mut sleeper, &mut buffer), Read::PublisherDown);
}

#[test]
fn a_reader_of_a_file_that_a_stranger_shortens_gets_an_error_or_data_and_no_signal() {
    let topic = Scratch::new();
    leave_dead(&topic);
    if !give_away(&topic) {
        return;
    }
    let _truncater = Truncater::start(&topic);
    let deadline = Instant::now() + Duration::from_secs(3);
    let (mut looks, mut failures) = (0, 0);
    while Instant::now() < deadline {
        match Info::read(&topic) {
            Ok(info) => assert!(
                matches!(info.state, State::Dead | State::Legacy),
                "{info:?}"
            ),
            Err(error) => {
                failures += 1;
                assert!(matches!(error, Error::BadSegment { .. }), "{error}");
            }
        }
        let options = SubscriberOptions {
            start: Start::History(9),
            ..Default::default()
        };
        if let Ok(mut subscriber) = Subscriber::open(&topic, &options) {
            let mut buffer = Vec::new();
            let _ = subscriber.try_read(&mut buffer);
            let _ = subscriber.wait(Duration::from_millis(2));
            let _ = subscriber.try_lease();
        }
        if let Ok(mut observer) = Observer::open(&topic, &ObserverOptions::default()) {
            let _ = observer.read_timeout(&mut Vec::new(), Duration::from_millis(2));
        }
        assert!(publisher(&topic).is_err());
        assert!(repair::reclaim_readers(&topic).is_err());
        let cleared = repair::clear_legacy_readers(&topic);
        assert!(!matches!(cleared, Ok(Repair::Made)), "{cleared:?}");
        assert!(!is_mapped(&topic));
        looks += 1;
    }
    assert!(
        looks > 10 && failures > 0,
        "{looks} looks, {failures} failures"
    );
}

#[test]
fn a_subscriber_under_which_the_name_goes_to_a_stranger_reads_that_without_a_mapping() {
    let topic = Scratch::new();
    let mut first = publisher(&topic).unwrap();
    let mut reader = subscriber(&topic, Guard::Auto);
    let mut buffer = Vec::new();
    first.publish(b"ours").unwrap();
    assert_eq!(next_message(&mut reader, &mut buffer), (0, 0));
    first.close();
    assert_eq!(next(&mut reader, &mut buffer), Read::PublisherDown);
    let mut second = publisher(&topic).unwrap();
    if !give_away(&topic) {
        return;
    }
    second.publish(b"theirs").unwrap();
    assert_eq!(next(&mut reader, &mut buffer), Read::PublisherUp);
    assert_eq!(next_message(&mut reader, &mut buffer), (0, 0));
    assert_eq!(second.info().readers, []);
}

#[test]
fn a_file_that_may_not_be_read_is_refused_by_its_owners_name_too() {
    let topic = Scratch::new();
    fs::create_dir(topic.path()).unwrap();
    let refused = give_away(&topic).then(|| publisher(&topic).unwrap_err());
    fs::remove_dir(topic.path()).unwrap();
    if let Some(refused) = refused {
        assert!(matches!(refused, Error::ForeignOwner { .. }), "{refused}");
    }
    assert!(!matches!(
        publisher(&topic),
        Err(Error::BadSegment {
            fault: Fault::NotAFile,
            ..
        })
    ));
}
