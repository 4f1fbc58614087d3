//! The cases of `programs/cases.c` and `cases.cpp`, each in a process of its own.

use std::process::Command;

use crate::toolchain::{
    C_CASES, CPP_CASES, CPP_CASES_BY_FMT, CPP_CASES_BY_PLAIN_FORMAT, CPP_CASES_BY_STD_FORMAT,
    Language, SANITIZED_C_CASES, SANITIZED_CPP_CASES, TestTopic, can_sanitize, compiles, succeed,
};

fn run(program: Option<Command>, case: &str) {
    let topic = TestTopic::new();
    if let Some(mut command) = program {
        succeed(command.args([case, topic.name()]));
    }
}

macro_rules! cases {
    ($list:ident, $module:ident, $program:ident: $($case:ident)*) => {
        const $list: &[&str] = &[$(stringify!($case)),*];

        mod $module {
            $(#[test] fn $case() {
                super::run(super::$program.command(), stringify!($case));
            })*
        }
    };
}

cases! { C, in_c, C_CASES:
    every_null_and_every_invalid_value_is_an_error_with_a_message
    options_of_another_version_are_an_error
    messages_of_one_part_and_of_many_arrive_whole
    a_message_that_does_not_fit_is_rejected_and_counted
    a_message_too_large_for_the_callers_buffer_is_kept
    a_publishers_start_and_end_are_events
    an_abandoned_topic_is_taken_over_at_the_same_number
    history_latest_and_losses
    waiting_ends_in_time_and_by_the_waker
    a_subscriber_in_use_by_another_thread_is_an_error
    a_topic_can_be_inspected_from_outside
    messages_over_the_given_size_are_rejected_and_counted
    the_clock_is_the_one_that_stamps_messages
    a_lease_keeps_a_message_in_its_slot_until_it_is_released
    a_fourth_lease_is_an_error_and_its_message_is_kept
    a_lease_returns_events_and_starts_with_the_kept_message
    a_loan_is_published_when_it_is_committed
    an_ended_publisher_keeps_its_loan_and_fails_all_calls
    a_publisher_without_a_thread_is_checked_by_its_owner
    a_guarded_subscriber_survives_a_truncated_file
    a_segment_is_written_and_read_as_in_the_wire_format
}

cases! { CPP, in_cpp, CPP_CASES:
    messages_arrive_in_order
    a_message_does_not_change_after_the_publisher_laps
    wait_for_ends_in_time
    try_read_does_not_wait
    a_message_that_does_not_fit_is_false
    a_second_live_publisher_throws
    invalid_names_and_geometries_throw_a_message
    publishers_and_subscribers_can_be_moved
    a_subscriber_waits_until_the_topic_exists
    a_subscriber_outlives_its_publisher
    a_seventeenth_subscriber_throws
    two_threads_share_a_publisher
    log_lines_are_formatted
    the_level_of_log_lines_can_be_set
    a_node_configures_its_topics_for_large_messages
    schedules_neither_drift_nor_burst
    a_node_connects_publishers_loops_and_subscriptions
    a_nodes_callbacks_may_be_const_functions_or_lambdas
    an_exception_of_a_callback_is_logged_and_the_node_continues
    a_node_can_be_stopped_from_a_callback_and_run_again
    a_node_that_was_stopped_before_does_not_run
    a_node_in_another_thread_is_joined_by_its_destructor
    one_signal_stops_several_nodes
    callbacks_may_add_subscriptions
    an_invalid_rate_throws
    a_lease_holds_its_message_until_it_is_destroyed
    a_fourth_lease_throws
    leases_can_be_moved_and_outlive_their_subscriber
    a_loan_is_published_by_commit_and_not_otherwise
    a_loan_that_outlives_its_publisher_throws
    a_child_leaves_the_topics_of_its_parent_alone
    a_silent_publisher_creates_a_removed_file_again
    a_silent_node_creates_its_removed_file_again
    a_publisher_reports_that_another_one_has_its_name
    a_loan_survives_the_removal_of_the_file
    a_child_that_exits_leaves_its_parents_statics_alone
    a_guarded_subscriber_throws_when_the_file_is_truncated
    a_camera_frame_has_the_layout_of_the_wire_format
    running_a_running_node_throws
}

#[test]
fn every_c_case_is_clean_under_address_sanitizer() {
    if can_sanitize(Language::C) {
        for case in C {
            run(SANITIZED_C_CASES.command(), case);
        }
    }
}

#[test]
fn every_cpp_case_is_clean_under_address_sanitizer() {
    if can_sanitize(Language::Cpp) {
        for case in CPP {
            run(SANITIZED_CPP_CASES.command(), case);
        }
    }
}

/// Tests the headers' own formatter, even if the standard library has std::format or {fmt} is
/// installed.
#[test]
fn log_lines_are_the_same_with_each_formatter() {
    let formatters = [
        (&CPP_CASES_BY_PLAIN_FORMAT, ""),
        (&CPP_CASES_BY_FMT, "#include <fmt/format.h>"),
        (
            &CPP_CASES_BY_STD_FORMAT,
            "#include <version>\n#ifndef __cpp_lib_format\n#error\n#endif",
        ),
    ];
    for (program, needed) in formatters {
        if compiles(needed, program.flags) {
            run(program.command(), "log_lines_are_formatted");
        }
    }
}
