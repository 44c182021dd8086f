//! Translation of the core's messages for Python: names of Rust calls become names of Python calls.

/// Pairs of phrases: a part of a message of the core that names a Rust call, and its replacement with the name of the Python call.
const PHRASES: [(&str, &str); 15] = [
    ("Options::from_model(&model)", "Options.from_model(model)"),
    ("choose ContactLaw::Mujoco and an integrator", "choose Options(contact=\"mujoco\", integrator=...)"),
    ("by analysis::overlaps::exclude(&model)", "by stepper.load(..., overlaps=\"exclude\")"),
    ("ContactLaw::Mujoco", "contact=\"mujoco\""),
    ("ContactLaw::Hard", "contact=\"hard\""),
    ("or leave them out with finish(false)", "or load with strict=False to leave them out"),
    ("for stepper_derivative::differentiate", "for method='implicit'"),
    ("for Simulation::visit_groups", "for method='implicit'"),
    ("; finite differences take all", "; method='fd' takes all"),
    ("the bytes of what Simulation::save_state gave", "what get_state returned, or its bytes"),
    ("Simulation::set_actuator_models", "Stepper(..., actuators=)"),
    ("all environments of a simulation", "all environments of a Stepper"),
    ("the simulation was created", "the Stepper was created"),
    ("create a simulation with", "create a Stepper with"),
    ("this simulation has", "this stepper has"),
];

/// Translates a message of the core: names of Rust calls become names of Python calls.
pub(crate) fn in_python(text: String) -> String {
    let text = PHRASES.iter().fold(text, |text, (rust, python)| text.replace(rust, python));
    replace_call(&text).unwrap_or(text)
}

/// Message with `model.replace("field", ..)` changed to `model.replace(field=...)`. The result is None if the message does not contain this
/// call.
fn replace_call(text: &str) -> Option<String> {
    let (before, rest) = text.split_once("model.replace(\"")?;
    let (field, after) = rest.split_once("\", ..)")?;
    let [before, after] =
        [before, after].map(|part| part.replace("a simulation of", "a Stepper of").replace("the simulation of", "the Stepper of"));
    Some(format!("{before}model.replace({field}=...){after}"))
}
