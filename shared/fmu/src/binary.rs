//! The C interface of FMI 2.0 (§2.1, §4.2.4) and 3.0 (§2.2, §4.2): functions looked up by name, declared by hand.
//!
//! The only file of this crate that is `unsafe`. What it relies on: a library that exports a function under a name
//! of FMI gives it FMI's signature, and frees what it allocated. Everything else (names, types, states, statuses) is
//! checked before a call. A library that breaks this takes its process with it, which is why each FMU has its own.
#![allow(unsafe_code)]

use crate::FmuError;
use crate::description::{Kind, Version};
use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::Path;
use std::sync::Mutex;

/// Lines kept of what an FMU says.
const SAID_MAX: usize = 8;
/// Longest line kept. [bytes]
const LINE_MAX: usize = 400;

type Component = *mut c_void;
type Status = c_int;

/// Status of a call: FMI's order.
const OK: Status = 0;
const WARNING: Status = 1;

/// Words for a status. FMI 2.0: discard 2, error 3, fatal 4, pending 5; FMI 3.0 the same up to 4.
fn status_name(status: Status) -> &'static str {
    match status {
        OK => "ok",
        WARNING => "warning",
        2 => "discard",
        3 => "error",
        4 => "fatal",
        5 => "pending",
        _ => "an unknown status",
    }
}

/// What an FMU said, newest last.
#[derive(Debug, Default)]
struct Said(Mutex<Vec<String>>);

impl Said {
    fn add(&self, text: *const c_char) {
        if text.is_null() {
            return;
        }
        // SAFETY: FMI: messages end with a zero and live during the call.
        let bytes = unsafe { CStr::from_ptr(text) }.to_bytes();
        let line = String::from_utf8_lossy(&bytes[..bytes.len().min(LINE_MAX)]).into_owned();
        if let Ok(mut lines) = self.0.lock() {
            if lines.len() == SAID_MAX {
                lines.remove(0);
            }
            lines.push(line);
        }
    }

    fn take(&self) -> String {
        self.0.lock().map(|mut lines| std::mem::take(&mut *lines).join("; ")).unwrap_or_default()
    }
}

/// `fmi2CallbackLogger` is variadic in C. The fixed arguments come in the same registers on the calling conventions
/// of Linux (System V x86-64, AAPCS64), and the further ones are not looked at: the format is kept as it is.
unsafe extern "C" fn log_2(
    environment: *mut c_void,
    _instance: *const c_char,
    _status: Status,
    _category: *const c_char,
    message: *const c_char,
) {
    if !environment.is_null() {
        // SAFETY: the environment is the `Said` of the instance, which outlives it.
        unsafe { &*environment.cast::<Said>() }.add(message);
    }
}

unsafe extern "C" fn log_3(
    environment: *mut c_void,
    _status: Status,
    _category: *const c_char,
    message: *const c_char,
) {
    if !environment.is_null() {
        // SAFETY: as above.
        unsafe { &*environment.cast::<Said>() }.add(message);
    }
}

/// `fmi2CallbackFunctions`.
#[repr(C)]
struct Callbacks2 {
    logger: unsafe extern "C" fn(*mut c_void, *const c_char, Status, *const c_char, *const c_char),
    allocate: unsafe extern "C" fn(usize, usize) -> *mut c_void,
    free: unsafe extern "C" fn(*mut c_void),
    step_finished: Option<unsafe extern "C" fn(*mut c_void, Status)>,
    environment: *mut c_void,
}

macro_rules! functions {
    ($(#[$doc:meta])* $table:ident { $( $field:ident $name:literal : fn($($argument:ty),*) $(-> $result:ty)?; )+ }) => {
        $(#[$doc])*
        struct $table { $( $field: unsafe extern "C" fn($($argument),*) $(-> $result)?, )+ }

        impl $table {
            /// Looks every function up; the names of those that are missing.
            fn of(library: &Library) -> Result<Self, Vec<String>> {
                let mut missing = Vec::new();
                $(
                    // SAFETY: FMI gives the function of this name this signature.
                    let $field = unsafe {
                        library.get::<unsafe extern "C" fn($($argument),*) $(-> $result)?>(concat!($name, "\0").as_bytes())
                    };
                    if $field.is_err() {
                        missing.push($name.to_owned());
                    }
                )+
                match ($( $field, )+) {
                    ($( Ok($field), )+) => Ok($table { $( $field: *$field, )+ }),
                    _ => Err(missing),
                }
            }
        }
    };
}

functions! {
    /// FMI 2.0, what a master needs.
    Two {
        version "fmi2GetVersion": fn() -> *const c_char;
        instantiate "fmi2Instantiate": fn(*const c_char, c_int, *const c_char, *const c_char, *const Callbacks2, c_int, c_int) -> Component;
        free "fmi2FreeInstance": fn(Component);
        setup "fmi2SetupExperiment": fn(Component, c_int, f64, f64, c_int, f64) -> Status;
        enter "fmi2EnterInitializationMode": fn(Component) -> Status;
        exit "fmi2ExitInitializationMode": fn(Component) -> Status;
        terminate "fmi2Terminate": fn(Component) -> Status;
        reset "fmi2Reset": fn(Component) -> Status;
        get_real "fmi2GetReal": fn(Component, *const u32, usize, *mut f64) -> Status;
        get_integer "fmi2GetInteger": fn(Component, *const u32, usize, *mut c_int) -> Status;
        get_boolean "fmi2GetBoolean": fn(Component, *const u32, usize, *mut c_int) -> Status;
        set_real "fmi2SetReal": fn(Component, *const u32, usize, *const f64) -> Status;
        set_integer "fmi2SetInteger": fn(Component, *const u32, usize, *const c_int) -> Status;
        set_boolean "fmi2SetBoolean": fn(Component, *const u32, usize, *const c_int) -> Status;
        set_string "fmi2SetString": fn(Component, *const u32, usize, *const *const c_char) -> Status;
        step "fmi2DoStep": fn(Component, f64, f64, c_int) -> Status;
    }
}

functions! {
    /// FMI 3.0, what a master needs.
    Three {
        version "fmi3GetVersion": fn() -> *const c_char;
        instantiate "fmi3InstantiateCoSimulation": fn(*const c_char, *const c_char, *const c_char, bool, bool, bool, bool, *const u32, usize, *mut c_void, unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char), *const c_void) -> Component;
        free "fmi3FreeInstance": fn(Component);
        enter "fmi3EnterInitializationMode": fn(Component, bool, f64, f64, bool, f64) -> Status;
        exit "fmi3ExitInitializationMode": fn(Component) -> Status;
        terminate "fmi3Terminate": fn(Component) -> Status;
        reset "fmi3Reset": fn(Component) -> Status;
        get_f64 "fmi3GetFloat64": fn(Component, *const u32, usize, *mut f64, usize) -> Status;
        get_f32 "fmi3GetFloat32": fn(Component, *const u32, usize, *mut f32, usize) -> Status;
        get_i8 "fmi3GetInt8": fn(Component, *const u32, usize, *mut i8, usize) -> Status;
        get_u8 "fmi3GetUInt8": fn(Component, *const u32, usize, *mut u8, usize) -> Status;
        get_i16 "fmi3GetInt16": fn(Component, *const u32, usize, *mut i16, usize) -> Status;
        get_u16 "fmi3GetUInt16": fn(Component, *const u32, usize, *mut u16, usize) -> Status;
        get_i32 "fmi3GetInt32": fn(Component, *const u32, usize, *mut i32, usize) -> Status;
        get_u32 "fmi3GetUInt32": fn(Component, *const u32, usize, *mut u32, usize) -> Status;
        get_i64 "fmi3GetInt64": fn(Component, *const u32, usize, *mut i64, usize) -> Status;
        get_u64 "fmi3GetUInt64": fn(Component, *const u32, usize, *mut u64, usize) -> Status;
        get_boolean "fmi3GetBoolean": fn(Component, *const u32, usize, *mut u8, usize) -> Status;
        set_f64 "fmi3SetFloat64": fn(Component, *const u32, usize, *const f64, usize) -> Status;
        set_f32 "fmi3SetFloat32": fn(Component, *const u32, usize, *const f32, usize) -> Status;
        set_i8 "fmi3SetInt8": fn(Component, *const u32, usize, *const i8, usize) -> Status;
        set_u8 "fmi3SetUInt8": fn(Component, *const u32, usize, *const u8, usize) -> Status;
        set_i16 "fmi3SetInt16": fn(Component, *const u32, usize, *const i16, usize) -> Status;
        set_u16 "fmi3SetUInt16": fn(Component, *const u32, usize, *const u16, usize) -> Status;
        set_i32 "fmi3SetInt32": fn(Component, *const u32, usize, *const i32, usize) -> Status;
        set_u32 "fmi3SetUInt32": fn(Component, *const u32, usize, *const u32, usize) -> Status;
        set_i64 "fmi3SetInt64": fn(Component, *const u32, usize, *const i64, usize) -> Status;
        set_u64 "fmi3SetUInt64": fn(Component, *const u32, usize, *const u64, usize) -> Status;
        set_boolean "fmi3SetBoolean": fn(Component, *const u32, usize, *const u8, usize) -> Status;
        set_string "fmi3SetString": fn(Component, *const u32, usize, *const *const c_char, usize) -> Status;
        step "fmi3DoStep": fn(Component, f64, f64, bool, *mut bool, *mut bool, *mut bool, *mut f64) -> Status;
    }
}

enum Functions {
    Two(Two),
    Three(Box<Three>),
}

/// Keeps an interpreter of Python in the process for FMUs that need one and do not link it (pythonfmu).
#[derive(Debug)]
pub struct Interpreter(#[allow(dead_code)] Library);

impl Interpreter {
    /// Loads a `libpython`, its symbols visible to whatever is loaded later.
    ///
    /// # Errors
    /// [`FmuError::Load`].
    pub fn load(library: &Path) -> Result<Self, FmuError> {
        // SAFETY: the initialisers of libpython are those of any host of Python.
        let loaded = unsafe { Library::open(Some(library), RTLD_NOW | libloading::os::unix::RTLD_GLOBAL) };
        loaded
            .map(Interpreter)
            .map_err(|e| FmuError::Load { library: library.display().to_string(), why: e.to_string() })
    }
}

/// A loaded binary with one instance of its model.
pub struct Slave {
    component: Component,
    functions: Functions,
    // Boxes: the FMU keeps their addresses.
    said: Box<Said>,
    _callbacks: Option<Box<Callbacks2>>,
    initialised: bool,
    // Last: closed behind the instance.
    _library: Library,
}

// SAFETY: FMI: an instance is not bound to a thread, only not to be called from two at once; `&mut` sees to that.
unsafe impl Send for Slave {}

impl Slave {
    /// Loads the library and makes an instance.
    ///
    /// # Errors
    /// [`FmuError::Load`], [`FmuError::MissingSymbols`], [`FmuError::Call`].
    pub fn new(
        version: Version,
        library: &Path,
        name: &str,
        token: &str,
        resources: &Path,
    ) -> Result<Self, FmuError> {
        let file = library.file_name().unwrap_or_default().to_string_lossy().into_owned();
        // SAFETY: its initialisers run here, in the process made for it.
        let loaded = unsafe { Library::open(Some(library), RTLD_NOW | RTLD_LOCAL) };
        let loaded = loaded.map_err(|e| FmuError::Load { library: file.clone(), why: deepest(&e) })?;
        let missing = |names| FmuError::MissingSymbols { library: file.clone(), names };
        let functions = match version {
            Version::Two => Functions::Two(Two::of(&loaded).map_err(missing)?),
            Version::Three => Functions::Three(Box::new(Three::of(&loaded).map_err(missing)?)),
        };
        let said = Box::<Said>::default();
        let environment = std::ptr::from_ref::<Said>(&said).cast_mut().cast::<c_void>();
        let text = |text: &str| CString::new(text.replace('\0', "")).unwrap_or_default();
        let (name, token) = (text(name), text(token));
        let mut callbacks = None;
        let component = match &functions {
            Functions::Two(two) => {
                let location = text(&format!("file://{}", uri_path(resources)));
                let table = callbacks.insert(Box::new(Callbacks2 {
                    logger: log_2,
                    allocate: libc::calloc,
                    free: libc::free,
                    step_finished: None,
                    environment,
                }));
                // SAFETY: strings end with zeros; the callbacks outlive the instance; 1 is fmi2CoSimulation.
                unsafe {
                    (two.instantiate)(
                        name.as_ptr(),
                        1,
                        token.as_ptr(),
                        location.as_ptr(),
                        &raw const **table,
                        0,
                        0,
                    )
                }
            }
            Functions::Three(three) => {
                // FMI 3.0: a path with a separator at its end.
                let path = text(&format!("{}/", resources.display()));
                // SAFETY: strings end with zeros; the environment outlives the instance; no intermediate update.
                unsafe {
                    (three.instantiate)(
                        name.as_ptr(),
                        token.as_ptr(),
                        path.as_ptr(),
                        false,
                        false,
                        false,
                        false,
                        std::ptr::null(),
                        0,
                        environment,
                        log_3,
                        std::ptr::null(),
                    )
                }
            }
        };
        if component.is_null() {
            let function = match version {
                Version::Two => "fmi2Instantiate",
                Version::Three => "fmi3InstantiateCoSimulation",
            };
            return Err(FmuError::Call { function, status: "no instance", said: said.take() });
        }
        Ok(Slave { component, functions, said, _callbacks: callbacks, initialised: false, _library: loaded })
    }

    fn checked(&self, function: &'static str, status: Status) -> Result<(), FmuError> {
        if status == OK || status == WARNING {
            return Ok(());
        }
        Err(FmuError::Call { function, status: status_name(status), said: self.said.take() })
    }

    /// Enters the initialisation at a time; start values are set before, inputs behind.
    ///
    /// # Errors
    /// [`FmuError::Call`].
    pub fn enter(&mut self, start_s: f64) -> Result<(), FmuError> {
        let c = self.component;
        // SAFETY: FMI's signatures; the instance is in the state in which they are allowed.
        unsafe {
            match &self.functions {
                Functions::Two(two) => {
                    self.checked("fmi2SetupExperiment", (two.setup)(c, 0, 0.0, start_s, 0, 0.0))?;
                    self.checked("fmi2EnterInitializationMode", (two.enter)(c))
                }
                Functions::Three(three) => self.checked(
                    "fmi3EnterInitializationMode",
                    (three.enter)(c, false, 0.0, start_s, false, 0.0),
                ),
            }
        }
    }

    /// Ends the initialisation.
    ///
    /// # Errors
    /// [`FmuError::Call`].
    pub fn exit(&mut self) -> Result<(), FmuError> {
        // SAFETY: as above.
        let status = unsafe {
            match &self.functions {
                Functions::Two(two) => (two.exit)(self.component),
                Functions::Three(three) => (three.exit)(self.component),
            }
        };
        self.checked("exit of the initialisation", status)?;
        self.initialised = true;
        Ok(())
    }

    /// Steps from `time_s` by `step_s`.
    ///
    /// # Errors
    /// [`FmuError::Call`], also when the FMU asks for the end or does not reach the step's end.
    pub fn step(&mut self, time_s: f64, step_s: f64) -> Result<(), FmuError> {
        match &self.functions {
            Functions::Two(two) => {
                // SAFETY: FMI's signature.
                let status = unsafe { (two.step)(self.component, time_s, step_s, 1) };
                self.checked("fmi2DoStep", status)
            }
            Functions::Three(three) => {
                let (mut event, mut ended, mut early, mut reached) = (false, false, false, time_s);
                // SAFETY: FMI's signature; the places written to live here.
                let status = unsafe {
                    (three.step)(
                        self.component,
                        time_s,
                        step_s,
                        true,
                        &raw mut event,
                        &raw mut ended,
                        &raw mut early,
                        &raw mut reached,
                    )
                };
                self.checked("fmi3DoStep", status)?;
                if ended || early {
                    let status = if ended { "a wish to end the simulation" } else { "early" };
                    return Err(FmuError::Call { function: "fmi3DoStep", status, said: self.said.take() });
                }
                Ok(())
            }
        }
    }

    /// Sets Float64 (Real) variables: one call.
    ///
    /// # Errors
    /// [`FmuError::Call`].
    pub fn set_floats(&mut self, references: &[u32], values: &[f64]) -> Result<(), FmuError> {
        assert_eq!(references.len(), values.len(), "a value for each reference");
        if references.is_empty() {
            return Ok(());
        }
        let (c, r, len) = (self.component, references.as_ptr(), references.len());
        // SAFETY: both arrays have the length given and live during the call.
        let status = unsafe {
            match &self.functions {
                Functions::Two(two) => (two.set_real)(c, r, len, values.as_ptr()),
                Functions::Three(three) => (three.set_f64)(c, r, len, values.as_ptr(), len),
            }
        };
        self.checked("set of real variables", status)
    }

    /// Gets Float64 (Real) variables: one call.
    ///
    /// # Errors
    /// [`FmuError::Call`].
    pub fn get_floats(&mut self, references: &[u32], values: &mut [f64]) -> Result<(), FmuError> {
        assert_eq!(references.len(), values.len(), "a value for each reference");
        if references.is_empty() {
            return Ok(());
        }
        let (c, r, len) = (self.component, references.as_ptr(), references.len());
        // SAFETY: both arrays have the length given and live during the call.
        let status = unsafe {
            match &self.functions {
                Functions::Two(two) => (two.get_real)(c, r, len, values.as_mut_ptr()),
                Functions::Three(three) => (three.get_f64)(c, r, len, values.as_mut_ptr(), len),
            }
        };
        self.checked("get of real variables", status)
    }

    /// Sets one variable of a numeric type; whole numbers are rounded and clamped to their type.
    ///
    /// # Errors
    /// [`FmuError::Call`].
    pub fn set(&mut self, kind: Kind, reference: u32, value: f64) -> Result<(), FmuError> {
        let (c, r) = (self.component, &raw const reference);
        let whole = value.round();
        macro_rules! three {
            ($three:ident, $function:ident, $type:ty) => {{
                let value = whole as $type;
                ($three.$function)(c, r, 1, &raw const value, 1)
            }};
        }
        // SAFETY: one reference, one value of the type, both alive during the call.
        let status = unsafe {
            match (&self.functions, kind) {
                (_, Kind::Float64) => return self.set_floats(&[reference], &[value]),
                (Functions::Two(two), Kind::Boolean) => {
                    let value = c_int::from(value != 0.0);
                    (two.set_boolean)(c, r, 1, &raw const value)
                }
                (Functions::Two(two), _) => {
                    let value = whole as c_int;
                    (two.set_integer)(c, r, 1, &raw const value)
                }
                (Functions::Three(three), Kind::Float32) => {
                    let value = value as f32;
                    (three.set_f32)(c, r, 1, &raw const value, 1)
                }
                (Functions::Three(three), Kind::Boolean) => {
                    let value = u8::from(value != 0.0);
                    (three.set_boolean)(c, r, 1, &raw const value, 1)
                }
                (Functions::Three(three), Kind::Int8) => three!(three, set_i8, i8),
                (Functions::Three(three), Kind::UInt8) => three!(three, set_u8, u8),
                (Functions::Three(three), Kind::Int16) => three!(three, set_i16, i16),
                (Functions::Three(three), Kind::UInt16) => three!(three, set_u16, u16),
                (Functions::Three(three), Kind::UInt32) => three!(three, set_u32, u32),
                (Functions::Three(three), Kind::Int64) => three!(three, set_i64, i64),
                (Functions::Three(three), Kind::UInt64) => three!(three, set_u64, u64),
                (Functions::Three(three), _) => three!(three, set_i32, i32),
            }
        };
        self.checked("set of a variable", status)
    }

    /// Gets one variable of a numeric type.
    ///
    /// # Errors
    /// [`FmuError::Call`].
    pub fn get(&mut self, kind: Kind, reference: u32) -> Result<f64, FmuError> {
        let (c, r) = (self.component, &raw const reference);
        let mut found = [0.0];
        macro_rules! three {
            ($three:ident, $function:ident, $type:ty) => {{
                let mut value: $type = Default::default();
                let status = ($three.$function)(c, r, 1, &raw mut value, 1);
                found[0] = value as f64;
                status
            }};
        }
        // SAFETY: one reference, one value of the type, both alive during the call.
        let status = unsafe {
            match (&self.functions, kind) {
                (_, Kind::Float64) => {
                    self.get_floats(&[reference], &mut found)?;
                    OK
                }
                (Functions::Two(two), _) => {
                    let mut value = 0;
                    let get = if kind == Kind::Boolean { two.get_boolean } else { two.get_integer };
                    let status = get(c, r, 1, &raw mut value);
                    found[0] = f64::from(value);
                    status
                }
                (Functions::Three(three), Kind::Float32) => three!(three, get_f32, f32),
                (Functions::Three(three), Kind::Boolean) => three!(three, get_boolean, u8),
                (Functions::Three(three), Kind::Int8) => three!(three, get_i8, i8),
                (Functions::Three(three), Kind::UInt8) => three!(three, get_u8, u8),
                (Functions::Three(three), Kind::Int16) => three!(three, get_i16, i16),
                (Functions::Three(three), Kind::UInt16) => three!(three, get_u16, u16),
                (Functions::Three(three), Kind::UInt32) => three!(three, get_u32, u32),
                (Functions::Three(three), Kind::Int64) => three!(three, get_i64, i64),
                (Functions::Three(three), Kind::UInt64) => three!(three, get_u64, u64),
                (Functions::Three(three), _) => three!(three, get_i32, i32),
            }
        };
        self.checked("get of a variable", status)?;
        Ok(found[0])
    }

    /// Sets a text, before the initialisation.
    ///
    /// # Errors
    /// [`FmuError::Call`].
    pub fn set_text(&mut self, reference: u32, value: &str) -> Result<(), FmuError> {
        let text = CString::new(value.replace('\0', "")).unwrap_or_default();
        let (c, r, texts) = (self.component, &raw const reference, [text.as_ptr()]);
        // SAFETY: one reference, one text, both alive during the call; FMI: the FMU copies it.
        let status = unsafe {
            match &self.functions {
                Functions::Two(two) => (two.set_string)(c, r, 1, texts.as_ptr()),
                Functions::Three(three) => (three.set_string)(c, r, 1, texts.as_ptr(), 1),
            }
        };
        self.checked("set of a text", status)
    }

    /// Back to the state behind the instantiation.
    ///
    /// # Errors
    /// [`FmuError::Call`].
    pub fn reset(&mut self) -> Result<(), FmuError> {
        // SAFETY: FMI's signatures.
        let status = unsafe {
            match &self.functions {
                Functions::Two(two) => (two.reset)(self.component),
                Functions::Three(three) => (three.reset)(self.component),
            }
        };
        self.initialised = false;
        self.checked("reset", status)
    }

    /// What the binary calls its version of FMI.
    #[must_use]
    pub fn version(&self) -> String {
        // SAFETY: FMI: a text that lives as long as the library.
        unsafe {
            let text = match &self.functions {
                Functions::Two(two) => (two.version)(),
                Functions::Three(three) => (three.version)(),
            };
            if text.is_null() { String::new() } else { CStr::from_ptr(text).to_string_lossy().into_owned() }
        }
    }
}

impl Drop for Slave {
    fn drop(&mut self) {
        // SAFETY: the instance is there and is not used behind this.
        unsafe {
            match &self.functions {
                Functions::Two(two) => {
                    if self.initialised {
                        (two.terminate)(self.component);
                    }
                    (two.free)(self.component);
                }
                Functions::Three(three) => {
                    if self.initialised {
                        (three.terminate)(self.component);
                    }
                    (three.free)(self.component);
                }
            }
        }
    }
}

impl std::fmt::Debug for Slave {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Slave").field("initialised", &self.initialised).finish_non_exhaustive()
    }
}

/// The innermost reason of an error: libloading's own words only say that dlopen failed.
fn deepest(error: &dyn std::error::Error) -> String {
    let mut error = error;
    while let Some(source) = error.source() {
        error = source;
    }
    error.to_string()
}

/// A path as in a `file` URI: everything but the plain characters as %XX.
fn uri_path(path: &Path) -> String {
    let plain = |byte: &u8| byte.is_ascii_alphanumeric() || b"/-_.~".contains(byte);
    path.to_string_lossy()
        .bytes()
        .map(|byte| if plain(&byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
        .collect()
}
