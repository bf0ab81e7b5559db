"""Conan 2, from a clone of the repository: `conan create capi/package/conan`. Needs cargo, and what cargo fetches."""
import os
import re

from conan import ConanFile
from conan.errors import ConanInvalidConfiguration
from conan.tools.build import cross_building
from conan.tools.files import copy, load, rm, rmdir


class Deltamorph(ConanFile):
    name = "deltamorph"
    description = "Morph targets (blend shapes) on raw Vulkan, applying only the changed weights"
    license = "MIT OR Apache-2.0"
    settings = "os", "arch", "compiler", "build_type"
    options = {"shared": [True, False]}
    default_options = {"shared": True}

    @property
    def _repository(self):
        return os.path.join(self.recipe_folder, "..", "..", "..")

    def set_version(self):
        workspace = load(self, os.path.join(self._repository, "Cargo.toml"))
        self.version = re.search('^version = "(.*)"$', workspace, re.M)[1]

    def export_sources(self):
        copy(self, "*", self._repository, self.export_sources_folder, excludes=("target/*", "*/target/*", ".git/*"))

    def requirements(self):
        self.requires("vulkan-headers/[>=1.3 <2]", transitive_headers=True)

    def validate(self):
        if self.settings.os not in ("Linux", "Macos") or cross_building(self):
            raise ConanInvalidConfiguration("this recipe builds for the Linux or macOS that it runs on")

    def package_id(self):
        # A C interface, built by cargo in one way.
        del self.info.settings.compiler
        del self.info.settings.build_type

    def build(self):
        cargo = "cargo build --locked --profile small --package deltamorph-c --all-features"
        self.run(f'{cargo} --target-dir "{self.build_folder}"', cwd=self.source_folder)

    def package(self):
        self.run(f'"{self.source_folder}/capi/install" "{self.package_folder}" "{self.build_folder}/small"')
        rm(self, "*.a" if self.options.shared else "*deltamorph_c.[sd]*", os.path.join(self.package_folder, "lib"))
        # Conan writes files of its own for CMake and pkg-config.
        rmdir(self, os.path.join(self.package_folder, "lib", "cmake"))
        rmdir(self, os.path.join(self.package_folder, "lib", "pkgconfig"))
        copy(self, "LICENSE-*", self.source_folder, os.path.join(self.package_folder, "licenses"))

    def package_info(self):
        self.cpp_info.libs = ["deltamorph_c"]
        if not self.options.shared:
            self.cpp_info.system_libs = ["pthread", "dl", "m", "gcc_s"] if self.settings.os == "Linux" else ["m"]
