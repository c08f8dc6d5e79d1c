//! Functions of a shared library that is loaded when a camera of it is first looked for.

/// Declares the functions of a library file, each found by its name when `load` is called.
macro_rules! library {
    ($file:literal; $(fn $name:ident($($arg:ident: $kind:ty),* $(,)?) $(-> $result:ty)?;)*) => {
        struct Functions {
            $($name: unsafe extern "C" fn($($kind),*) $(-> $result)?,)*
        }

        impl Functions {
            fn find(library: &::libloading::Library) -> Result<Self, ::libloading::Error> {
                // SAFETY: the types are those of the library's headers.
                unsafe { Ok(Self { $($name: *library.get(concat!(stringify!($name), "\0").as_bytes())?,)* }) }
            }
        }

        static FUNCTIONS: ::std::sync::OnceLock<Result<Functions, String>> = ::std::sync::OnceLock::new();

        /// Loads the library, once. Every other function requires that it has been loaded.
        ///
        /// # Errors
        /// The system's message if the library is missing or lacks a function.
        pub fn load() -> Result<(), String> {
            let functions = FUNCTIONS.get_or_init(|| {
                // SAFETY: the initialisers of the library have no requirements.
                let library = unsafe { ::libloading::Library::new($file) }.map_err(|e| e.to_string())?;
                let functions = Functions::find(&library).map_err(|e| e.to_string());
                // It cannot be unloaded: it may have started threads.
                std::mem::forget(library);
                functions
            });
            functions.as_ref().map(|_| ()).map_err(String::clone)
        }

        fn loaded() -> &'static Functions {
            match FUNCTIONS.get() {
                Some(Ok(functions)) => functions,
                // Cameras and lists exist only after the library was loaded.
                _ => std::process::abort(),
            }
        }

        $(
            pub unsafe extern "C" fn $name($($arg: $kind),*) $(-> $result)? {
                // SAFETY: as promised by the caller.
                unsafe { (loaded().$name)($($arg),*) }
            }
        )*
    };
}

pub(super) use library;
