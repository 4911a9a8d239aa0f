//! Tyres: Magic Formula, property files, tables, relaxation.
