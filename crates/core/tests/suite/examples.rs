//! Tests that run the programs of the folder `examples`.

#[path = "../../examples/batch.rs"]
mod batch;
#[path = "../../examples/controller.rs"]
mod controller;
#[path = "../../examples/parameters.rs"]
mod parameters;
#[path = "../../examples/states.rs"]
mod states;

#[test]
fn a_batch_is_stepped_and_its_contacts_and_poses_are_read() {
    batch::main().unwrap();
}

#[test]
fn a_controller_balances_a_pole() {
    controller::main().unwrap();
}

#[test]
fn a_state_is_saved_and_restored() {
    states::main().unwrap();
}

#[test]
fn environments_have_parameters_of_their_own() {
    parameters::main().unwrap();
}
