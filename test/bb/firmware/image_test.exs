defmodule BB.Firmware.ImageTest do
  @moduledoc "What the configuration of boards says, as far as the host can hold it to that."

  # Robots of other tests must not be armed while an update is let in here.
  use ExUnit.Case, async: false

  import BB.Test.Eventually

  alias BB.Test.Keys

  setup_all do
    {:ok, _} = Application.ensure_all_started(:ssh)
    %{config: Config.Reader.read!("config/target.exs", env: :prod, target: :rpi4)}
  end

  describe "a board" do
    test "lets updates in through the gate, by functions that are there", %{config: config} do
      for key <- [:precheck_callback, :success_callback] do
        {module, function, args} = config[:ssh_subsystem_fwup][key]
        assert Code.ensure_loaded?(module)
        assert function_exported?(module, function, length(args))
      end
    end

    test "is built of files that are there", %{config: config} do
      for {_what, path} <- config[:nerves][:firmware], do: assert(File.exists?(path), path)
    end

    test "leaves validation to the guard of ours", %{config: config} do
      assert config[:nerves_runtime][:startup_guard_enabled] == false
    end

    test "starts the watchers of a robot with options that they take", %{config: config} do
      for module <- [BB.Firmware.Guard, BB.Firmware.Gate, BB.Firmware.Network] do
        options = [robot: Ganglion.Robot, name: nil] ++ config[:ganglion][module]
        assert %{start: {^module, :start_link, [^options]}} = module.child_spec(options)
      end

      for {module, _handle} <- [config[:ganglion][:board], config[:ganglion][:network]],
          do: assert(Code.ensure_loaded?(module))
    end

    test "shows rows of ours in its message of the day", %{config: config} do
      {module, function, args} = config[:nerves_motd][:extra_rows]
      assert [[{_, _} | _] | _] = apply(module, function, args)
    end

    test "keeps host keys where updates leave them, and looks at them before ssh does", %{
      config: config
    } do
      assert "/data/" <> _ = config[:nerves_ssh][:system_dir]
      init = config[:nerves_runtime][:init_module]
      assert %{start: {^init, :start_link, _}} = init.child_spec([])
      assert [:nerves_runtime | _] = config[:shoehorn][:init]
    end

    test "starts applications again that end, by a handler that is one of shoehorn's", %{
      config: config
    } do
      handler = config[:shoehorn][:handler]
      assert Code.ensure_loaded?(handler)

      for {name, arity} <- [init: 1, application_started: 2, application_exited: 3],
          do: assert(function_exported?(handler, name, arity))
    end

    test "keeps what was typed, and has heart wait for the guard" do
      text = File.read!("rel/vm.args.eex")
      assert text =~ ~r/^-kernel shell_history enabled$/m
      assert text =~ ~r/^-env HEART_INIT_TIMEOUT 600$/m
      [vm, _extra] = String.split(text, "-extra")
      assert vm =~ "shell_history"
    end

    test "senses on its own buses", %{config: config} do
      assert config[:ganglion][:i2c] == Circuits.I2C
    end

    test "is built of packages that are used" do
      files = ~w(config/firmware.exs rootfs_overlay/etc/iex.exs) ++ Path.wildcard("lib/**/*.ex")
      named = Enum.map_join(files, &letters(File.read!(&1)))

      for [_, name] <- Regex.scan(~r/^      {:(\w+), "~>/m, File.read!("mix.exs")),
          not String.starts_with?(name, "nerves_system_"),
          do: assert(named =~ letters(name), "nothing but mix.exs names #{name}")
    end

    # Circuits.I2C is circuits_i2c.
    defp letters(text), do: text |> String.downcase() |> String.replace(["_", "."], "")

    @tag :tmp_dir
    test "of another project has all but the robot and its name from here, and keys of its own",
         %{config: config, tmp_dir: project} do
      file = Path.expand("config/firmware.exs")
      keys = Path.join(project, "firmware/keys/ssh")
      File.mkdir_p!(keys)
      File.write!(Path.join(keys, "ada.pub"), "ssh-ed25519 AAAA ada\n")

      shared = File.cd!(project, fn -> Config.Reader.read!(file, env: :prod, target: :rpi4) end)

      assert shared[:nerves_ssh][:authorized_keys] == ["ssh-ed25519 AAAA ada"]
      refute Keyword.has_key?(shared[:ganglion], :robot)

      for {application, settings} <- config, application not in [:mdns_lite, :ganglion] do
        assert Keyword.delete(shared[application], :authorized_keys) ==
                 Keyword.delete(settings, :authorized_keys)
      end

      own = Keyword.keys(config[:ganglion]) -- Keyword.keys(shared[:ganglion])
      assert own -- [:robot, :i2c] == []
    end

    test "keeps nobody's login key that is not in its image", %{config: config} do
      refute String.starts_with?(config[:nerves_ssh][:user_dir], "/data")
    end
  end

  describe "an image on simulated buses" do
    @variable "GANGLION_BUSES"

    defp buses(target, value) do
      before = System.get_env(@variable)
      on_exit(fn -> System.put_env([{@variable, before}]) end)
      System.put_env([{@variable, value}])
      Config.Reader.read!("config/target.exs", env: :prod, target: target)[:ganglion]
    end

    test "is that for QEMU, and for any board whose build asks for it" do
      for {target, value} <- [qemu_aarch64: nil, qemu_aarch64: "simulated", rpi4: "simulated"] do
        config = buses(target, value)
        assert {config[:i2c], config[:gpio]} == {BB.Bus.Sim.I2C, BB.Bus.Sim.GPIO}
        assert config[:robot] == Ganglion.Robot
      end
    end

    test "is none where the board's own are asked for" do
      for {target, value} <- [qemu_aarch64: "real", rpi4: "real", x86_64: nil] do
        config = buses(target, value)
        assert config[:i2c] == Circuits.I2C
      end
    end

    test "takes no other word" do
      error = assert_raise ArgumentError, fn -> buses(:rpi4, "fake") end

      assert error.message ==
               "expected GANGLION_BUSES to be real or simulated, got: \"fake\"; " <>
                 "the default for rpi4 is real"
    end
  end

  describe "logging in, with the board's options for OTP's ssh," do
    setup %{config: config} do
      {user, public} = Keys.pair()
      {host, _} = Keys.pair()
      options = [key_cb: {Keys, host: host, authorized: [public]}, shell: shell()]

      options = [exec: {:direct, &__MODULE__.run/1}] ++ options

      {:ok, daemon} =
        :ssh.daemon({127, 0, 0, 1}, 0, options ++ config[:nerves_ssh][:daemon_option_overrides])

      on_exit(fn -> :ssh.stop_daemon(daemon) end)
      {:ok, info} = :ssh.daemon_info(daemon)
      %{port: info[:port], user: user}
    end

    # As nerves_ssh runs a command.
    def run(command) do
      {result, _bindings} = Code.eval_string(command)
      {:ok, inspect(result)}
    catch
      kind, value -> {:error, Exception.format(kind, value, __STACKTRACE__)}
    end

    # As nerves_ssh starts it, which depends on Elixir's version.
    defp shell do
      file = Path.expand("rootfs_overlay/etc/iex.exs")

      cond do
        Version.match?(System.version(), ">= 1.18.0") ->
          {:iex, :start, [[dot_iex: file], {:elixir_utils, :noop, []}]}

        Version.match?(System.version(), ">= 1.17.0") ->
          {:iex, :start, [[dot_iex_path: file], {:elixir_utils, :noop, []}]}

        true ->
          {IEx, :start, [[dot_iex_path: file]]}
      end
    end

    defp connect(port, key, more \\ []) do
      options = [user: ~c"ada", user_interaction: false, silently_accept_hosts: true]
      :ssh.connect({127, 0, 0, 1}, port, [key_cb: {Keys, user: key}] ++ options ++ more, 10_000)
    end

    test "works with the key, and shows the robot's console", %{port: port, user: user} do
      {:ok, connection} = connect(port, user)
      {:ok, channel} = :ssh_connection.session_channel(connection, 10_000)
      :success = :ssh_connection.ptty_alloc(connection, channel, [])
      :ok = :ssh_connection.shell(connection, channel)
      :ok = :ssh_connection.send(connection, channel, "firmware(:no_guard)\n")
      assert read_until(connection, "is not running") =~ "validation"
      :ssh.close(connection)
    end

    test "runs commands, of which all that they print arrives", %{port: port, user: user} do
      robot = loud_robot()
      start_supervised!(robot)
      {:ok, connection} = connect(port, user)

      for {command, words} <- commands(robot) do
        text = printed(connection, command, words)
        refute text =~ "do not show"
        refute text =~ "command failed"
        assert for(<<char <- text>>, char > 0x7E, do: char) == [], text
      end

      :ssh.close(connection)
    end

    test "runs commands that fail, and says so", %{port: port, user: user} do
      {:ok, connection} = connect(port, user)

      for command <- [
            ~s|Ganglion.Console.sensors(:"robot…日本")|,
            ~s|Ganglion.Console.watch("…")|,
            ~s|Ganglion.Console.i2c_scan("…")|
          ] do
        assert command(connection, command) =~ ~r/command failed|cannot be opened/
      end

      :ssh.close(connection)
    end

    # A sensor that is down is also seen while it is started again, without its reason.
    defp printed(connection, command, words) do
      eventually(fn ->
        Process.put(:printed, command(connection, command))
        Process.get(:printed) =~ words && Process.get(:printed)
      end)
    rescue
      ExUnit.AssertionError -> flunk("#{command} printed: #{Process.get(:printed)}")
    end

    # Each function of the console, with what it must print for that robot.
    defp commands(robot) do
      console = "Ganglion.Console."
      name = inspect(robot)

      covered = [
        sensors: {"(#{name})", "loud"},
        health: {"(#{name})", "too hot: 90 degC, +-5 %"},
        topics: {"(#{name})", "sensor/base_link/"},
        ring: {"()", ~r/topic|none/},
        params: {"([], #{name})", "naive"},
        watch: {"([:sensor], seconds: 0.2, robot: #{name})", "watched for 0.2 s"},
        firmware: {"(:no_guard)", "is not running"},
        arm: {"(#{name})", "is armed"},
        disarm: {"(#{name})", "is disarmed"},
        estop: {"(#{name})", "arming is forbidden"},
        release: {"(#{name})", "is disarmed"},
        revert: {"()", "the other slot has no firmware"},
        i2c_scan: {"()", ~r/bus|none/},
        motd_rows: {"(#{name})", "Robot"}
      ]

      names = for {name, _arity} <- Ganglion.Console.__info__(:functions), uniq: true, do: name
      assert Enum.sort(Keyword.keys(covered)) == Enum.sort(names)
      for {function, {args, words}} <- covered, do: {"#{console}#{function}#{args}", words}
    end

    # A robot whose names, values and errors have characters of all kinds.
    defp loud_robot do
      robot =
        BB.Test.Robot.create(
          quote do
            parameters do
              param :mode, type: :string, default: "naïve – µ²…"
            end

            topology do
              link :base_link do
                sensor :loud, BB.Test.Probe
                sensor :"größe…", BB.Test.Probe
              end
            end
          end
        )

      BB.Test.Probe.script(robot, :loud,
        init: fn _ -> {:stop, {:shutdown, "too hot: 90 °C, ±5 %…日本"}} end
      )

      BB.Test.Probe.script(robot, :"größe…",
        init: fn opts ->
          BB.publish(robot, [:sensor, :base_link, :"größe…"], reading())
          {:ok, opts}
        end
      )

      robot
    end

    defp reading do
      BB.Message.new!(BB.Message.Sensor.Range, :range,
        radiation_type: :infrared,
        field_of_view: 0.1,
        min_range: 0.02,
        max_range: 1.5,
        range: 0.4
      )
    end

    # What the client sees of it, to the end.
    defp command(connection, command) do
      {:ok, channel} = :ssh_connection.session_channel(connection, 10_000)
      :success = :ssh_connection.exec(connection, channel, command, 30_000)
      read_all(connection, channel, "")
    end

    defp read_all(connection, channel, read) do
      receive do
        {:ssh_cm, ^connection, {:data, ^channel, _type, data}} ->
          read_all(connection, channel, read <> data)

        {:ssh_cm, ^connection, {:closed, ^channel}} ->
          read

        {:ssh_cm, ^connection, _other} ->
          read_all(connection, channel, read)
      after
        30_000 -> flunk("the command did not end; it printed: #{read}")
      end
    end

    test "fails without a key, with a wrong one, and with a password", %{port: port} do
      {stranger, _} = Keys.pair()
      assert {:error, _} = connect(port, nil)
      assert {:error, _} = connect(port, stranger)
      assert {:error, _} = connect(port, nil, password: ~c"password")
    end
  end

  describe "a script of the firmware's" do
    @scripts Path.wildcard("firmware/scripts/*")

    test "says how it is used, and refuses what it does not know" do
      assert length(@scripts) == 4

      for script <- @scripts do
        assert {"usage: " <> usage, 0} = run(script, ["--help"])
        assert String.starts_with?(usage, script)
        assert {text, 2} = run(script, ["--nonsense"])
        assert text =~ "--nonsense; see --help"
      end
    end

    test "that needs a file says which one is missing" do
      for script <- ~w(burn sign upload) do
        assert {text, 1} = run("firmware/scripts/" <> script, ["no-such-image.fw"])
        assert text =~ "no-such-image.fw is missing"
      end
    end

    defp run(script, args), do: System.cmd(Path.expand(script), args, stderr_to_stdout: true)

    @describetag :tmp_dir

    # An ssh that says what fwup says, and ends with a status as ssh does.
    defp upload(root, said, status) do
      File.write!(Path.join(root, "said"), said)
      ssh = Path.join(root, "ssh")

      File.write!(ssh, """
      #!/bin/sh
      echo "$@" > "#{root}/arguments"
      cat > "#{root}/sent"
      cat "#{root}/said"
      exit #{status}
      """)

      File.chmod!(ssh, 0o755)
      image = Path.join(root, "app.fw")
      File.write!(image, "the image")
      path = root <> ":" <> System.get_env("PATH")

      System.cmd(Path.expand("firmware/scripts/upload"), [image, "ada.local"],
        env: [{"PATH", path}],
        stderr_to_stdout: true
      )
    end

    @progress "\r 50% [======      ]\r100% [============]"

    test "that uploads passes on what the board has said", %{tmp_dir: root} do
      success = @progress <> "\nSuccess!\nElapsed time: 2.1 s\n"

      # The board restarts, and takes the connection with it.
      for status <- [0, 255], do: assert({^success, 0} = upload(root, success, status))
      assert File.read!(Path.join(root, "sent")) == "the image"
      assert File.read!(Path.join(root, "arguments")) == "-s ada.local fwup\n"

      refused = "Error: the robot is armed: disarm it first\n"
      assert {^refused, 1} = upload(root, refused, 1)

      for said <- ["", @progress, @progress <> "\nno Success! today\n"],
          do: assert({^said, 255} = upload(root, said, 255))

      # A failure stays one, whatever was said before.
      assert {_, 1} = upload(root, success, 1)
    end
  end

  describe "with the real fwup," do
    @describetag :tmp_dir
    unless System.find_executable("fwup"), do: @describetag(skip: "fwup is not installed")

    # What a board's system has of its own, and a small image in the place of the real one.
    @system_provisioning ~s(uboot_setenv(uboot-env, "enable_uboot_overlays", "1"\)\n)
    @image """
    meta-product = "ganglion"
    file-resource payload { host-path = "payload" }
    uboot-environment uboot-env {
      block-offset = 0
      block-count = 16
    }
    task complete {
      on-init {
        uboot_clearenv(uboot-env)
        include("${NERVES_PROVISIONING}")
      }
      on-resource payload { raw_write(64) }
    }
    task upgrade {
      on-resource payload { raw_write(128) }
    }
    """

    setup %{tmp_dir: root} do
      File.mkdir_p!(Path.join(root, "firmware"))
      File.cp_r!("firmware/scripts", Path.join(root, "firmware/scripts"))
      File.mkdir_p!(Path.join(root, "fwup_include"))
      File.write!(Path.join(root, "fwup_include/provisioning.conf"), @system_provisioning)
      File.write!(Path.join(root, "payload"), "payload")
      File.write!(Path.join(root, "image.conf"), @image)

      env = [
        {"NERVES_PROVISIONING", Path.expand("firmware/provisioning.conf")},
        {"NERVES_SDK_IMAGES", root}
      ]

      assert {_, 0} = in_folder(root, "fwup", ~w(-c -f image.conf -o app.fw), env)
      :ok
    end

    test "the keys made sign an image that the board's check takes, and no other is taken", %{
      tmp_dir: root
    } do
      assert {_, 0} = in_folder(root, "firmware/scripts/keys", [])
      assert {text, 1} = in_folder(root, "firmware/scripts/keys", [])
      assert text =~ "is there already"
      assert %{mode: mode} = File.stat!(Path.join(root, "firmware/keys/firmware.priv"))
      assert Bitwise.band(mode, 0o077) == 0

      assert {_, 0} = in_folder(root, "firmware/scripts/sign", ["app.fw"])
      assert {_, 0} = checked(root, "app.signed.fw")
      assert {text, 1} = checked(root, "app.fw")
      assert text =~ "Expecting signed firmware"

      File.rm!(Path.join(root, "firmware/keys/firmware.priv"))
      public = Path.join(root, "rootfs_overlay/etc/ganglion/firmware.pub")
      File.rename!(public, public <> ".first")
      assert {_, 0} = in_folder(root, "firmware/scripts/keys", [])
      assert {_, 0} = in_folder(root, "firmware/scripts/sign", ["app.fw", "other.fw"])
      File.rename!(public <> ".first", public)
      assert {text, 1} = checked(root, "other.fw")
      assert text =~ "signature"
    end

    test "what fwup says last, as the board starts it, is what an upload takes for success", %{
      tmp_dir: root
    } do
      written = "fwup --exit-handshake -a --no-unmount -d card.img -t complete < app.fw"
      {said, _status} = in_folder(root, "sh", ["-c", written])
      [said, _handshake] = String.split(said, <<0x1A>>, parts: 2)
      assert said |> String.split(["\r", "\n"]) |> Enum.member?("Success!")
    end

    test "an update is taken by the options of the gate, once, and only signed", context do
      root = context.tmp_dir
      assert {_, 0} = in_folder(root, "firmware/scripts/keys", [])
      assert {_, 0} = in_folder(root, "firmware/scripts/sign", ["app.fw"])
      assert {_, 0} = in_folder(root, "firmware/scripts/burn", ["app.fw", "card.img"])
      gate = :"gate_#{System.unique_integer([:positive])}"
      key = Path.join(root, "rootfs_overlay/etc/ganglion/firmware.pub")
      opts = [public_key: key, folder: Path.join(root, "guard"), settle_ms: 0]

      assert {:ok, [fwup_extra_options: options]} = BB.Firmware.Gate.precheck(gate, opts)
      update = ~w(-a -q -t upgrade -d card.img -i)
      assert {_, 0} = in_folder(root, "fwup", update ++ ["app.signed.fw" | options])
      assert {text, 1} = in_folder(root, "fwup", update ++ ["app.fw" | options])
      assert text =~ "Expecting signed firmware"

      File.rm!(key)
      opts = Keyword.put(opts, :folder, Path.join(root, "other"))
      assert {:error, text} = BB.Firmware.Gate.precheck(:another_gate, opts)
      assert text =~ "is missing"
    end

    test "a card is told what the environment says, beside what its system writes", %{
      tmp_dir: root
    } do
      env = [
        {"NERVES_SERIAL_NUMBER", "g-0007"},
        {"GANGLION_NAME", "ada"},
        {"GANGLION_WIFI_SSID", ~s(the "lab" $1)}
      ]

      assert {_, 0} = in_folder(root, "firmware/scripts/burn", ["app.fw", "card.img"], env)

      assert told(Path.join(root, "card.img")) == %{
               "enable_uboot_overlays" => "1",
               "nerves_serial_number" => "g-0007",
               "ganglion_name" => "ada",
               "ganglion_wifi_ssid" => ~s(the "lab" $1),
               "ganglion_wifi_passphrase" => "",
               "ganglion_wifi_country" => ""
             }
    end

    # As the board does it: BB.Firmware.Gate gives that option to fwup.
    defp checked(root, image) do
      key = ["--public-key-file", "rootfs_overlay/etc/ganglion/firmware.pub"]
      in_folder(root, "fwup", ~w(-a -q -t complete -d card.img -i) ++ [image | key])
    end

    # U-Boot's environment: a checksum, then name=value, each ended by a zero, up to an empty one.
    defp told(card) do
      <<_crc::32, variables::binary>> = card |> File.read!() |> binary_part(0, 16 * 512)
      [variables, _rest] = :binary.split(variables, <<0, 0>>)

      for variable <- String.split(variables, <<0>>),
          into: %{},
          do: variable |> String.split("=", parts: 2) |> List.to_tuple()
    end

    defp in_folder(root, command, args, env \\ []) do
      command = if command =~ "/", do: Path.join(root, command), else: command
      System.cmd(command, args, cd: root, env: env, stderr_to_stdout: true)
    end
  end

  defp read_until(connection, wanted, read \\ "") do
    if read =~ wanted do
      read
    else
      assert_receive {:ssh_cm, ^connection, {:data, _, _, data}}
      read_until(connection, wanted, read <> data)
    end
  end
end
