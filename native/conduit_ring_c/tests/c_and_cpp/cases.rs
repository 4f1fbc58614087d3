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
    every_null_and_every_wrong_value_is_refused_with_a_sentence
    options_of_another_version_are_refused
    messages_of_one_part_and_of_many_arrive_whole
    a_message_that_does_not_fit_is_refused_and_counted
    a_message_too_large_for_the_callers_buffer_is_kept
    a_publishers_coming_and_going_are_events
    an_abandoned_topic_is_taken_over_at_the_same_number
    history_latest_and_losses
    waiting_ends_in_time_and_by_the_waker
    a_second_thread_is_refused_by_a_subscriber
    a_topic_can_be_looked_at_from_outside
    what_is_too_large_is_counted_by_the_size_as_given
    the_clock_is_the_one_that_stamps_messages
    a_lease_keeps_a_message_in_its_slot_until_it_is_released
    a_fourth_lease_is_refused_and_its_message_kept
    a_lease_tells_events_and_begins_with_the_message_that_was_kept
    a_loan_is_published_when_it_is_committed
    an_ended_publisher_keeps_its_loan_and_refuses_everything
    a_publisher_without_a_thread_is_looked_after_by_its_owner
    a_guarded_subscriber_survives_a_file_that_is_cut_off
    a_segment_is_made_and_read_as_the_wire_format_says
}

cases! { CPP, in_cpp, CPP_CASES:
    messages_arrive_in_order
    a_message_stays_what_it_was_after_the_publisher_laps
    wait_for_ends_in_time
    try_read_does_not_wait
    a_message_that_does_not_fit_is_false
    a_second_live_publisher_throws
    wrong_names_and_shapes_throw_a_sentence
    publishers_and_subscribers_can_be_moved
    a_subscriber_waits_until_the_topic_exists
    a_subscriber_outlives_its_publisher
    a_seventeenth_subscriber_throws
    two_threads_share_a_publisher
    log_lines_are_formatted
    the_level_of_log_lines_can_be_set
    a_node_shapes_its_topics_for_large_messages
    schedules_neither_drift_nor_burst
    a_node_connects_publishers_loops_and_subscriptions
    a_nodes_callbacks_may_be_const_functions_or_lambdas
    a_callback_that_throws_is_logged_and_the_node_goes_on
    a_node_can_be_stopped_from_a_callback_and_run_again
    a_node_that_was_stopped_before_does_not_run
    a_node_in_another_thread_is_joined_by_its_destructor
    one_signal_stops_several_nodes
    callbacks_may_add_subscriptions
    a_wrong_rate_throws
    a_lease_holds_its_message_until_it_is_destroyed
    a_fourth_lease_throws
    leases_can_be_moved_and_outlive_their_subscriber
    a_loan_is_published_by_commit_and_not_otherwise
    a_loan_that_outlives_its_publisher_throws
    a_child_leaves_the_topics_of_its_parent_alone
    a_silent_publisher_makes_a_removed_file_anew
    a_silent_node_makes_its_removed_file_anew
    a_publisher_whose_name_another_has_says_so
    a_loan_survives_that_the_file_is_removed
    a_child_that_exits_leaves_its_parents_statics_alone
    a_guarded_subscriber_throws_when_the_file_is_cut_off
    a_camera_frame_is_laid_out_as_the_wire_format_says
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

/// Where the standard library has no std::format and {fmt} is not installed, the headers' own formatter is the one tested.
#[test]
fn log_lines_are_the_same_whoever_formats_them() {
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
