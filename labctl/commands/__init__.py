"""The commands, one file per group: each reads its options, calls the library, and shows what came out."""
