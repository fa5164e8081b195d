"""Kind "codegen": C code of a robot's functions, written by ``gtmodel codegen``."""
