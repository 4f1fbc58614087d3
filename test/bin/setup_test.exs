defmodule Bin.SetupTest do
  @moduledoc """
  Runs `bin/setup` on machines that lack something: its PATH is a folder of stand-ins, and a test
  removes some of them.
  """

  use ExUnit.Case, async: true

  alias BB.Test.Run

  @tools ~w(bash cut dirname env head id paste printf sed sh sort tr true uname cat ln chmod)
  @nobody "65534"

  setup do
    folder = Path.join(System.tmp_dir!(), Run.unique("setup"))
    for name <- ~w(bin path home), do: File.mkdir_p!(Path.join(folder, name))
    for name <- ~w(setup environment), do: File.cp!("bin/#{name}", "#{folder}/bin/#{name}")
    on_exit(fn -> File.rm_rf!(folder) end)
    open_way(folder)

    machine = %{folder: folder, path: Path.join(folder, "path")}
    for tool <- @tools, do: File.ln_s!(System.find_executable(tool), "#{machine.path}/#{tool}")

    for command <- ~w(mix cc gcc c++ cmake make pkg-config git curl python3 cargo apt-get),
        do: stand_in(machine, command)

    stand_in(machine, "elixir", "echo 1.14.0")
    stand_in(machine, "python3", "echo 3.11.2")
    stand_in(machine, "rustc", "echo 'rustc 1.91.0 (f8297e351 2025-10-28)'")
    erlang(machine, ~w(crypto dialyzer proper runtime_tools sasl ssh tools))
    %{machine: machine}
  end

  test "does and prints nothing if nothing is missing", %{machine: machine} do
    for command <- [[], ~w(demo), ~w(test), ~w(check)],
        do: assert(setup_as(:nobody, machine, command) == {"", 0})
  end

  test "a command needs its own tools and no others", %{machine: machine} do
    erlang(machine, ~w(crypto runtime_tools sasl ssh tools))
    for command <- ~w(c++ cmake make pkg-config git python3), do: take_away(machine, command)

    for command <- ~w(demo bench ganglion),
        do: assert(setup_as(:nobody, machine, [command]) == {"", 0})

    assert asked(machine, ~w(check)) == ~w(erlang-dialyzer g++ python3 python3-venv)

    assert asked(machine, ~w(test)) ==
             ~w(cmake erlang-proper g++ git make pkg-config python3 python3-venv)

    assert asked(machine, []) ==
             ~w(cmake erlang-dialyzer erlang-proper g++ git make pkg-config python3 python3-venv)
  end

  test "a user without root and sudo is told what to ask for", %{machine: machine} do
    take_away(machine, "cmake")
    {said, status} = setup_as(:nobody, machine, [])
    assert status == 1
    assert said =~ "no root, no sudo"
    assert said =~ "as root"
    assert said =~ "  apt-get update && apt-get install -y --no-install-recommends cmake\n"
    assert done(machine) == []
  end

  test "so is a user whose sudo needs a password, without a terminal", %{machine: machine} do
    take_away(machine, "cmake")
    stand_in(machine, "sudo", "exit 1")
    assert {said, 1} = setup_as(:nobody, machine, [])
    assert said =~ "apt-get install -y --no-install-recommends cmake\n"
    assert done(machine) == []
  end

  test "each step is numbered, and sudo takes them where it may", %{machine: machine} do
    take_away(machine, "cmake")
    File.touch!(Path.join(machine.folder, "done"))
    File.chmod!(Path.join(machine.folder, "done"), 0o666)
    stand_in(machine, "sudo", ~S(if [ "$1" = -n ]; then shift; fi; exec "$@"))

    assert {"setup: [1/2] updating the package lists of apt\nsetup: [2/2] installing cmake\n", 0} =
             setup_as(:nobody, machine, [])

    assert [_, install] = done(machine)
    assert install =~ ~r/^install .*--no-install-recommends cmake$/
  end

  test "a step that fails is the last one, and is reported", %{machine: machine} do
    take_away(machine, "cmake")
    stand_in(machine, "apt-get", "exit 100")
    stand_in(machine, "sudo", ~S(if [ "$1" = -n ]; then shift; fi; exec "$@"))
    assert {said, 1} = setup_as(:nobody, machine, [])
    assert said =~ "setup: apt-get update failed"
    refute said =~ "[2/2]"
  end

  test "Rust is installed without root, by rustup", %{machine: machine} do
    take_away(machine, "rustc")
    rustc = ~S(printf '#!/bin/sh\necho rustc 1.95.0\n' >"$HOME/rustc"; chmod +x "$HOME/rustc")
    stand_in(machine, "curl", "cat <<'END'\n#{rustc}\nEND")
    File.chmod!(Path.join(machine.folder, "home"), 0o777)
    File.ln_s!(Path.join(machine.folder, "home/rustc"), Path.join(machine.path, "rustc"))

    assert setup_as(:nobody, machine, ~w(demo)) ==
             {"setup: [1/1] installing Rust (stable, with rustup)\n", 0}
  end

  test "a Rust that stays too old is reported, with the remedy", %{machine: machine} do
    stand_in(machine, "rustc", "echo 'rustc 1.63.0 (4b91a6ea7 2022-08-08)'")
    stand_in(machine, "curl", "echo true")
    File.chmod!(Path.join(machine.folder, "home"), 0o777)
    assert {said, 1} = setup_as(:nobody, machine, ~w(demo))
    assert said =~ "Rust 1.91 or newer is needed, and the first rustc in PATH is rustc 1.63.0"
  end

  test "an Elixir that is too old is reported, with the needed version", %{machine: machine} do
    stand_in(machine, "elixir", "echo 1.10.4")
    assert {said, 1} = setup_as(:nobody, machine, ~w(demo))
    assert said =~ "Elixir 1.14 or newer is needed, found 1.10.4"
  end

  test "on other systems, the corresponding packages are printed", %{machine: machine} do
    take_away(machine, "apt-get")
    take_away(machine, "c++")
    erlang(machine, ~w(crypto dialyzer sasl tools))

    for {manager, command} <- [
          {"dnf", "dnf install erlang erlang-proper gcc-c++"},
          {"pacman", "pacman -S --needed erlang gcc"},
          {"apk", "apk add erlang g++"}
        ] do
      stand_in(machine, manager)
      assert {said, 1} = setup_as(:nobody, machine, [])
      assert said =~ "  #{command}\n"
      take_away(machine, manager)
    end

    assert {said, 1} = setup_as(:nobody, machine, [])
    assert said =~ "the counterparts of Debian's packages: erlang-crypto erlang-proper"
  end

  test "an unknown command is an invalid argument", %{machine: machine} do
    assert {said, 2} = setup_as(:nobody, machine, ~w(dmeo))

    assert said =~
             "unknown command \"dmeo\"; expected one of: bench chaos check demo docs ganglion new test"

    assert {_, 2} = setup_as(:nobody, machine, ~w(demo test))
  end

  test "every command in bin/ sets up its own tools, and no others" do
    for file <- Path.wildcard("bin/*"), text = File.read!(file) do
      name = Path.basename(file)

      calls = Regex.scan(~r/^\s*bin\/setup\b *(\w*)/m, text)
      asked = for [_call, asked] <- calls, uniq: true, do: asked
      assert asked -- [name] == []
    end
  end

  # The packages that `bin/setup` installs, without its other output.
  defp asked(machine, arguments) do
    {said, 1} = setup_as(:nobody, machine, arguments)
    [_, packages] = Regex.run(~r/--no-install-recommends (.*)$/m, said)
    String.split(packages)
  end

  defp setup_as(:nobody, machine, arguments) do
    command = [Path.join(machine.folder, "bin/setup") | arguments]
    [program | arguments] = as_nobody() ++ command

    System.cmd(program, arguments,
      env: [{"PATH", machine.path}, {"HOME", Path.join(machine.folder, "home")}],
      stderr_to_stdout: true
    )
  end

  defp as_nobody do
    case System.cmd("id", ["-u"]) do
      {"0\n", 0} ->
        [
          System.find_executable("setpriv"),
          "--reuid=#{@nobody}",
          "--regid=#{@nobody}",
          "--clear-groups",
          "--"
        ]

      {_somebody, 0} ->
        []
    end
  end

  # The folder of a run belongs to its owner; the user nobody has to reach it.
  defp open_way("/"), do: :ok

  defp open_way(folder) do
    mode = File.stat!(folder).mode
    if Bitwise.band(mode, 0o001) == 0, do: File.chmod!(folder, Bitwise.bor(mode, 0o001))
    open_way(Path.dirname(folder))
  end

  defp erlang(machine, applications),
    do: stand_in(machine, "erl", "echo #{Enum.join(applications, " ")} ''")

  # A stand-in that records its arguments, if it may be called.
  defp stand_in(machine, name, does \\ nil) do
    file = Path.join(machine.path, name)
    note = ~s([ ! -w "#{machine.folder}/done" ] || echo "$@" >>"#{machine.folder}/done")
    _ = File.rm(file)
    File.write!(file, "#!/bin/sh\n#{does || note}\n")
    File.chmod!(file, 0o755)
  end

  defp take_away(machine, name), do: File.rm!(Path.join(machine.path, name))

  defp done(machine) do
    case File.read(Path.join(machine.folder, "done")) do
      {:ok, text} -> String.split(text, "\n", trim: true)
      {:error, :enoent} -> []
    end
  end
end
