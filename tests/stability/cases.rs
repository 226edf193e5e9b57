//! Every case of `rotorwatch bench stability`.

use rotorwatch::bench::stability::rows::Row;
use rotorwatch::bench::stability::{CASES, Rows, bearings, oscillators, rotors};
use rotorwatch::bench::table;

/// Prints the rows, and fails if one of them does not hold.
#[expect(clippy::print_stdout, reason = "the table is what the suite is for")]
fn hold(rows: Rows) {
    let rows = rows.unwrap();
    for row in &rows {
        print!("{}", table::text_row(&Row::COLUMNS, &row.cells()));
    }
    let missed: Vec<&Row> = rows.iter().filter(|row| !row.holds()).collect();
    assert!(!rows.is_empty() && missed.is_empty(), "{missed:#?}");
}

/// One test a case, and a test that none is forgotten.
macro_rules! cases {
    ($($name:ident: $case:path,)+) => {
        $(#[test] fn $name() { hold($case()); })+

        #[test]
        fn every_case_is_a_test() {
            assert_eq!(CASES.len(), [$(stringify!($name)),+].len());
            assert!(CASES.iter().all(|(_, reason)| !reason.is_empty()));
        }
    };
}

cases! {
    a_hertz_spring_softens_and_loses_contact: oscillators::hertz_spring,
    a_pumped_spring_grows_as_mathieu_says: oscillators::pumped_spring,
    motion_without_damping_lasts: oscillators::without_damping,
    unbalance_and_bow_are_the_closed_form: oscillators::unbalance_and_bow,
    the_rig_has_its_natural_frequencies: rotors::natural_frequencies,
    the_contact_approach_is_the_elliptic_solution: rotors::contact_approach,
    a_run_up_through_the_critical_speed_has_its_peak: rotors::run_up_through_critical,
    cut_at_edges_steps_have_the_fourth_order_and_uncut_the_first: bearings::order_of_steps,
    errors_stay_what_was_measured: bearings::errors_of_steps,
    every_fit_finds_its_rest: bearings::rest,
    modes_alone_leave_a_stiff_bearing_too_stiff: bearings::truncated_basis,
    the_shapes_chosen_err_ten_times_the_accuracy_at_most: bearings::shapes_chosen,
    balls_that_pass_under_the_load_shake_the_shaft: bearings::varying_compliance,
    an_edge_on_a_sample_is_not_lost: bearings::edge_on_a_sample,
    two_edges_in_a_step_are_not_lost: bearings::two_edges_in_a_step,
    speed_may_pass_zero: bearings::reversing,
    the_mirror_image_moves_alike: bearings::mirror_image,
    the_same_scene_moves_alike_twice: bearings::same_twice,
}
