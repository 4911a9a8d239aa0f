//! The functions of FMI 2.0 for co-simulation (§2.1, §4.2.4), exported by name. The only file here with `unsafe`.
//!
//! What they rely on is what the standard demands of a master: pointers that live during the call, arrays of the length
//! given, an instance that `fmi2Instantiate` gave and `fmi2FreeInstance` did not yet take. A panic never leaves.
#![allow(unsafe_code, non_snake_case)]

use crate::model::{Model, Resource, Type};
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

const OK: c_int = 0;
const ERROR: c_int = 3;

type Logger = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char);

/// The begin of `fmi2CallbackFunctions`.
#[repr(C)]
struct Callbacks {
    logger: Option<Logger>,
    allocate: *const c_void,
    free: *const c_void,
    step_finished: *const c_void,
    environment: *mut c_void,
}

struct Instance {
    model: Model,
    name: CString,
    logger: Option<Logger>,
    environment: *mut c_void,
    start_s: f64,
    started: bool,
}

/// `fmi2CallbackLogger` is variadic in C; without further arguments the fixed ones are passed alike on Linux.
fn tell(logger: Option<Logger>, environment: *mut c_void, name: &CStr, text: &str) {
    let Some(logger) = logger else { return };
    let text = CString::new(text.replace('%', "%%").replace('\0', "")).unwrap_or_default();
    // SAFETY: the master's own function and environment; texts live during the call.
    unsafe { logger(environment, name.as_ptr(), ERROR, c"error".as_ptr(), text.as_ptr()) };
}

/// Does something with an instance; nothing that goes wrong in Rust gets out.
fn with(c: *mut c_void, act: impl FnOnce(&mut Instance) -> Result<(), String>) -> c_int {
    if c.is_null() {
        return ERROR;
    }
    // SAFETY: an instance of `fmi2Instantiate`, used by one thread at a time (§2.1.1).
    let instance = unsafe { &mut *c.cast::<Instance>() };
    let done = catch_unwind(AssertUnwindSafe(|| act(instance)));
    let text = match done {
        Ok(Ok(())) => return OK,
        Ok(Err(text)) => text,
        Err(_) => "internal error".to_owned(),
    };
    tell(instance.logger, instance.environment, &instance.name, &text);
    ERROR
}

fn text_of(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: a text with a zero at its end.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}

/// The folder that a `file` URI names.
fn folder(uri: &str) -> PathBuf {
    let path = uri.strip_prefix("file:").unwrap_or(uri);
    // file:///a, file://localhost/a, file:/a
    let path = path.strip_prefix("//").map_or(path, |rest| rest.find('/').map_or(rest, |at| &rest[at..]));
    let bytes = path.as_bytes();
    let mut plain = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let code = (bytes[at] == b'%').then(|| path.get(at + 1..at + 3)).flatten();
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => {
                plain.push(byte);
                at += 3;
            }
            None => {
                plain.push(bytes[at]);
                at += 1;
            }
        }
    }
    PathBuf::from(String::from_utf8_lossy(&plain).into_owned())
}

fn load(uri: &str, guid: &str) -> Result<Model, String> {
    let file = folder(uri).join("model.json");
    let text = std::fs::read_to_string(&file).map_err(|e| format!("{}: {e}", file.display()))?;
    let whole: serde_json::Value = serde_json::from_str(&text).map_err(|e| e.to_string())?;
    if whole["guid"] != guid {
        return Err("the guid is not that of the resources".to_owned());
    }
    let resource: Resource = serde_json::from_value(whole["model"].clone()).map_err(|e| e.to_string())?;
    Model::new(resource)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SetDebugLogging(c: *mut c_void, _: c_int, _: usize, _: *const *const c_char) -> c_int {
    with(c, |_| Ok(()))
}

#[unsafe(no_mangle)]
extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_int,
    guid: *const c_char,
    resources: *const c_char,
    callbacks: *const c_void,
    _visible: c_int,
    _logging: c_int,
) -> *mut c_void {
    let callbacks = callbacks.cast::<Callbacks>();
    let (logger, environment) = if callbacks.is_null() {
        (None, std::ptr::null_mut())
    } else {
        // SAFETY: the master's structure, alive during the call at least.
        unsafe { ((*callbacks).logger, (*callbacks).environment) }
    };
    let name = CString::new(text_of(name)).unwrap_or_default();
    let made = catch_unwind(|| {
        if kind != 1 {
            return Err("only co-simulation".to_owned());
        }
        load(&text_of(resources), &text_of(guid))
    });
    match made {
        Ok(Ok(model)) => {
            let instance = Instance { model, name, logger, environment, start_s: 0.0, started: false };
            Box::into_raw(Box::new(instance)).cast()
        }
        other => {
            let text = match other {
                Ok(Err(text)) => text,
                _ => "internal error".to_owned(),
            };
            tell(logger, environment, &name, &text);
            std::ptr::null_mut()
        }
    }
}

#[unsafe(no_mangle)]
extern "C" fn fmi2FreeInstance(c: *mut c_void) {
    if !c.is_null() {
        // SAFETY: made by `Box::into_raw` in fmi2Instantiate, and freed once (§2.1.6).
        drop(unsafe { Box::from_raw(c.cast::<Instance>()) });
    }
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SetupExperiment(c: *mut c_void, _: c_int, _: f64, start: f64, _: c_int, _: f64) -> c_int {
    with(c, |instance| {
        instance.start_s = start;
        Ok(())
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi2EnterInitializationMode(c: *mut c_void) -> c_int {
    with(c, |_| Ok(()))
}

#[unsafe(no_mangle)]
extern "C" fn fmi2ExitInitializationMode(c: *mut c_void) -> c_int {
    with(c, |instance| {
        instance.model.start(instance.start_s);
        instance.started = true;
        Ok(())
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi2Terminate(c: *mut c_void) -> c_int {
    with(c, |_| Ok(()))
}

#[unsafe(no_mangle)]
extern "C" fn fmi2Reset(c: *mut c_void) -> c_int {
    with(c, |instance| {
        instance.started = false;
        instance.model.reset()
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi2DoStep(c: *mut c_void, _time: f64, length: f64, _: c_int) -> c_int {
    with(c, |instance| match instance.model.step(length) {
        Ok(true) => Ok(()),
        Ok(false) => Err("the model's state was not sound: the last sound one is held".to_owned()),
        Err(rule) => Err(rule.to_owned()),
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi2CancelStep(_: *mut c_void) -> c_int {
    ERROR
}

/// The references and values of a call.
///
/// # Safety
/// Both have `len` entries, or `len` is 0.
unsafe fn arrays<'a, T>(references: *const u32, len: usize, values: *mut T) -> (&'a [u32], &'a mut [T]) {
    if len == 0 || references.is_null() || values.is_null() {
        return (&[], &mut []);
    }
    // SAFETY: as the caller promises.
    unsafe { (std::slice::from_raw_parts(references, len), std::slice::from_raw_parts_mut(values, len)) }
}

fn read<T>(c: *mut c_void, r: *const u32, len: usize, v: *mut T, kind: Type, of: fn(f64) -> T) -> c_int {
    // SAFETY: FMI's own promise.
    let (references, values) = unsafe { arrays(r, len, v) };
    with(c, |instance| {
        for (reference, value) in references.iter().zip(values) {
            let found = instance.model.get(kind, *reference);
            *value = of(found.ok_or_else(|| format!("{kind:?} variable {reference}: there is none"))?);
        }
        Ok(())
    })
}

fn write<T: Copy>(
    c: *mut c_void,
    r: *const u32,
    len: usize,
    v: *const T,
    kind: Type,
    of: fn(T) -> f64,
) -> c_int {
    // SAFETY: FMI's own promise; nothing is written to the values.
    let (references, values) = unsafe { arrays(r, len, v.cast_mut()) };
    with(c, |instance| {
        for (reference, value) in references.iter().zip(values) {
            if !instance.model.set(kind, *reference, of(*value), instance.started) {
                return Err(format!("{kind:?} variable {reference}: cannot be set now, or not to this"));
            }
        }
        Ok(())
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetReal(c: *mut c_void, r: *const u32, len: usize, v: *mut f64) -> c_int {
    read(c, r, len, v, Type::Real, |value| value)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetInteger(c: *mut c_void, r: *const u32, len: usize, v: *mut c_int) -> c_int {
    read(c, r, len, v, Type::Integer, |value| value as c_int)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetBoolean(c: *mut c_void, r: *const u32, len: usize, v: *mut c_int) -> c_int {
    read(c, r, len, v, Type::Boolean, |value| c_int::from(value != 0.0))
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SetReal(c: *mut c_void, r: *const u32, len: usize, v: *const f64) -> c_int {
    write(c, r, len, v, Type::Real, |value| value)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SetInteger(c: *mut c_void, r: *const u32, len: usize, v: *const c_int) -> c_int {
    write(c, r, len, v, Type::Integer, f64::from)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SetBoolean(c: *mut c_void, r: *const u32, len: usize, v: *const c_int) -> c_int {
    write(c, r, len, v, Type::Boolean, |value| f64::from(value != 0))
}

/// Functions of what these FMUs have not: texts, stored states, derivatives, asynchronous steps.
macro_rules! absent {
    ($($name:ident($($argument:ty),*);)+) => { $(
        #[unsafe(no_mangle)]
        extern "C" fn $name($(_: $argument),*) -> c_int {
            ERROR
        }
    )+ };
}

type Any = *const c_void;

absent! {
    fmi2GetString(Any, Any, usize, Any);
    fmi2SetString(Any, Any, usize, Any);
    fmi2GetFMUstate(Any, Any);
    fmi2SetFMUstate(Any, Any);
    fmi2FreeFMUstate(Any, Any);
    fmi2SerializedFMUstateSize(Any, Any, Any);
    fmi2SerializeFMUstate(Any, Any, Any, usize);
    fmi2DeSerializeFMUstate(Any, Any, usize, Any);
    fmi2GetDirectionalDerivative(Any, Any, usize, Any, usize, Any, Any);
    fmi2SetRealInputDerivatives(Any, Any, usize, Any, Any);
    fmi2GetRealOutputDerivatives(Any, Any, usize, Any, Any);
    fmi2GetStatus(Any, c_int, Any);
    fmi2GetRealStatus(Any, c_int, Any);
    fmi2GetIntegerStatus(Any, c_int, Any);
    fmi2GetBooleanStatus(Any, c_int, Any);
    fmi2GetStringStatus(Any, c_int, Any);
}
